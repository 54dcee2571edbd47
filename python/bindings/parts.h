// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The parts of the module, one per file. Each adds its classes and functions; module.cpp calls them in this order.
#pragma once

#include <pybind11/pybind11.h>

namespace accessvdb::python {

void bindErrors(pybind11::module_& module);
void bindLabels(pybind11::module_& module);
void bindTool(pybind11::module_& module);
void bindParams(pybind11::module_& module);
void bindAnswers(pybind11::module_& module);
void bindSnapshot(pybind11::module_& module);
void bindAccessMap(pybind11::module_& module);
void bindRegions(pybind11::module_& module);
void bindField(pybind11::module_& module);
void bindLive(pybind11::module_& module);
void bindScans(pybind11::module_& module);
void bindStoredField(pybind11::module_& module);
void bindRender(pybind11::module_& module);

}  // namespace accessvdb::python
