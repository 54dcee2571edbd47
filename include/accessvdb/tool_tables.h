// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the tables of a tool will take in memory, told before a field makes them.
#pragma once

#include <cstdint>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"

namespace accessvdb {

/// Host memory of the tables that follow from the tool, the voxel size and the directions alone.
struct ToolTableBytes {
  std::uint64_t held = 0;    ///< as long as the field lives
  std::uint64_t making = 0;  ///< at most, while the field is made
};

/// An estimate from eight of the directions, within a tenth of what a field then holds. It takes the share 8 / D of the
/// time and memory that making the tables takes. With BackendKind::Auto they are counted as for the CPU, the larger.
/// @throws InvalidArgument (params), ResourceLimit "tool.span", "tool.columns" as the field would
[[nodiscard]] ACCESSVDB_API ToolTableBytes toolTableBytes(const ToolGeometry& tool, const FieldParams& params);

}  // namespace accessvdb
