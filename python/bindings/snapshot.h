// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Snapshots: the points stay in C++ memory, NumPy views them.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "accessvdb/types.h"

namespace accessvdb::python {

/// A snapshot on the heap, for Python to keep.
std::shared_ptr<FieldSnapshot> keep(FieldSnapshot&& snapshot);

}  // namespace accessvdb::python
