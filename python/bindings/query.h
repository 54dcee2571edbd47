// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batched queries to a field.
#pragma once

#include <pybind11/pybind11.h>

#include "bindings/locked_field.h"

namespace accessvdb::python {

/// query() and query_along() of AccessibilityField.
void bindQueries(pybind11::class_<LockedField>& field);

}  // namespace accessvdb::python
