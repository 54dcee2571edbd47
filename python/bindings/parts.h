// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The parts of the module, one per file. Each adds its classes and functions; module.cpp calls them in this order.
#pragma once

#include <pybind11/pybind11.h>

#include <vector>

#include "accessvdb/rolling_field.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_spec.h"

namespace accessvdb::python {

void bindErrors(pybind11::module_& module);
void bindLabels(pybind11::module_& module);
void bindTool(pybind11::module_& module);
void bindParams(pybind11::module_& module);
void bindAnswers(pybind11::module_& module);
void bindDistanceGrid(pybind11::module_& module);
void bindSnapshot(pybind11::module_& module);
void bindAccessMap(pybind11::module_& module);
void bindRegions(pybind11::module_& module);
void bindField(pybind11::module_& module);
void bindLive(pybind11::module_& module);
void bindRolling(pybind11::module_& module);
void bindScans(pybind11::module_& module);
void bindStoredField(pybind11::module_& module);
void bindRender(pybind11::module_& module);

/// As RollingField.status().
pybind11::dict rollingDict(const RollingStatus& now);
/// @param tools  sequence of ToolSpec and ToolGeometry
std::vector<ToolSpec> toolsFrom(const pybind11::object& tools);
/// @throws TypeError unless exactly one of them is given
void requireOneOf(const pybind11::object& tool, const pybind11::object& tools);
/// None counts as missing, as every number that is not finite.
double stampFrom(const pybind11::object& stamp_s);
/// "imu", or roll and pitch in radians. @throws TypeError, ValueError
io::Level levelFrom(const pybind11::object& level);

}  // namespace accessvdb::python
