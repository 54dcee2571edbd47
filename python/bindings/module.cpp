// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb._accessvdb: the library for Python. Names, types and docs for users: accessvdb/__init__.pyi.
#include "accessvdb/config.h"
#include "bindings/parts.h"

PYBIND11_MODULE(_accessvdb, module) {
  using namespace accessvdb::python;
  module.attr("__version__") = ACCESSVDB_VERSION;
  bindErrors(module);
  bindLabels(module);
  bindTool(module);
  bindParams(module);
  bindSnapshot(module);
  bindAccessMap(module);
  bindRegions(module);
  bindAnswers(module);
  bindDistanceGrid(module);
  bindLive(module);
  bindRolling(module);
  bindScans(module);
  bindField(module);
  bindStoredField(module);
  bindRender(module);
}
