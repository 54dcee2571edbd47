// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Many questions to a field at a time.
#pragma once

#include <pybind11/pybind11.h>

#include "bindings/locked_field.h"

namespace accessvdb::python {

/// query() and query_along() of AccessibilityField.
void bindQueries(pybind11::class_<LockedField>& field);

}  // namespace accessvdb::python
