// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A list of tools out of a caller's array.
#pragma once

#include <cstddef>
#include <vector>

#include "accessvdb/c_api.h"
#include "accessvdb/tool_spec.h"

namespace accessvdb::capi {

/// @param tools  [count], each of `size` bytes
/// @throws InvalidArgument as requireArray(), "c_api.struct_size", "c_api.unknown_fields", "c_api.handle", and what
///         OrientationSet::parse() throws
[[nodiscard]] std::vector<ToolSpec> toolsFromC(const accessvdb_tool_spec* tools, std::size_t size, std::size_t count);

}  // namespace accessvdb::capi
