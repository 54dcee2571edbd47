// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lists of tools for tests of fields with several.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tool_spec.h"
#include "support/determinism_support.h"

namespace accessvdb::test {

/// ACCESSVDB_TEST_BACKEND=cuda runs them all on a GPU.
inline BackendKind testedBackend() { return backendNamedBy("ACCESSVDB_TEST_BACKEND"); }

inline FieldParams paramsAt(double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.backend = testedBackend();
  return params;
}

inline ToolSpec spec(ToolGeometry tool, OrientationSet orientations, int max_collisions, std::string name = {}) {
  return {std::move(tool), std::move(orientations), 0, std::move(name), max_collisions};
}

inline std::vector<ToolSpec> threeTools() {
  return {spec(armTool(), OrientationSet::yaw(), 40, "arm"),
          spec(ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(20), -1, "pencil"),
          spec(ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 0, "pruner")};
}

}  // namespace accessvdb::test
