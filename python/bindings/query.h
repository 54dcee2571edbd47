// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batched queries to a field.
#pragma once

#include <pybind11/pybind11.h>

#include "bindings/locked_field.h"

namespace accessvdb::python {

/// Number of a tool. @throws InvalidArgument "tool.index"
std::size_t toolFrom(const pybind11::object& tool);
/// distance_grid(), free_arcs_deg(), approaches() and views().
void bindApproaches(pybind11::class_<LockedField>& field);
/// query(), query_along(), fits() and fits_along().
void bindQueries(pybind11::class_<LockedField>& field);

}  // namespace accessvdb::python
