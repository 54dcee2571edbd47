// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a field makes of a tool: how much memory its tables will take, predicted before they are built, its rolls, and
/// what is wrong with it.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"
#include "accessvdb/tool_spec.h"

namespace accessvdb {

/// Host memory of the tables that depend only on the tool, the voxel size and the directions.
struct ToolTableBytes {
  std::uint64_t held = 0;    ///< as long as the field lives
  std::uint64_t making = 0;  ///< at most, while the field is built
};

/// An estimate from eight of the directions, within a tenth of what the field will hold. It takes 8 / D of the time and
/// memory of building the tables. BackendKind::Auto counts as the CPU, which needs more.
/// @throws InvalidArgument (params), ResourceLimit "tool.span", "tool.columns" as the field would
[[nodiscard]] ACCESSVDB_API ToolTableBytes toolTableBytes(const std::vector<ToolSpec>& tools,
                                                          const FieldParams& params);

/// How many rolls about its body this tool takes in each orientation: ApproachParams::rolls, or what the rule says.
[[nodiscard]] ACCESSVDB_API int rollsOf(const ToolGeometry& tool, const ApproachParams& approach);

/// Width of the widest opening of a tool's surface: 0 if it is closed, infinity where it is a sheet without another
/// side. Openings of up to a quarter of the tool's size are closed: its voxels contain those that it would have without
/// them. Of a tool that is wide open only the surface counts, and what that encloses.
[[nodiscard]] ACCESSVDB_API double openingWidth_m(const ToolGeometry& tool);
[[nodiscard]] ACCESSVDB_API bool isWideOpen(const ToolGeometry& tool);

/// The largest share of the tool's voxels, in any of its orientations and rolls, that is so near its tip that
/// collisions there do not count (self-exclusion). Of a tool that hides more than half, labels say little. It takes
/// about the time of building the tables; AccessibilityField::toolShareHidden() knows it already.
[[nodiscard]] ACCESSVDB_API double toolShareHidden(const ToolGeometry& tool, const FieldParams& params);

}  // namespace accessvdb
