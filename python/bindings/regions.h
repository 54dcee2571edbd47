// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Parts of a map taken out by hand.
#pragma once

#include <pybind11/pybind11.h>

#include "bindings/locked_field.h"

namespace accessvdb::python {

/// remove_region(), what_if() and order_cuts() of AccessibilityField.
void bindRegionCalls(pybind11::class_<LockedField>& field);

}  // namespace accessvdb::python
