// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools in one field: each point says which of them reach it (docs/tools.md).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/orientations.h"
#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"

namespace accessvdb {

/// A tool, and what a field asks of it. Its result is that of a field with this tool alone, bit for bit.
struct ToolSpec {
  ToolGeometry tool;
  OrientationSet orientations = {};  ///< as ApproachParams::orientations
  int rolls = 0;                     ///< as ApproachParams::rolls
  std::string name = {};             ///< [A-Za-z0-9_-]{1,32}, of this tool only; empty: made from the tool's
  int max_collisions = 0;            ///< as ScoringParams::max_collisions
};

/// A list of this tool alone, with the parameters' own values. @throws as namedTools()
[[nodiscard]] ACCESSVDB_API std::vector<ToolSpec> onlyTool(const ToolGeometry& tool, const FieldParams& params);

/// Most tools of a field: SurfacePoint::tools has a bit for each.
inline constexpr std::size_t kMostTools = 32;

/// Each tool, and behind it the same tool grown by each margin (ToolGeometry::grownBy()), with its orientations and its
/// limit: points then say how much room the tool has (SurfacePoint::margin_m). Names are filled in; those of grown
/// tools end with the margin ("pruner_20mm"). A margin of 0 is the tool itself and adds nothing.
/// @param tools  without margins  @param margins_m  in any order
/// @throws InvalidArgument "tool.margin" (negative, not finite, larger than a tool), "tool.count", "tool.name"
[[nodiscard]] ACCESSVDB_API std::vector<ToolSpec> withMargins(std::vector<ToolSpec> tools,
                                                              std::vector<double> margins_m);

/// The same tools with all names filled in. A name made from a tool's own ("builtin:pruner", "pruner.stl" -> "pruner")
/// gets a number behind it where it is taken.
/// @throws InvalidArgument "tool.count" (none, or more than kMostTools), "tool.name" (odd, or of two tools)
[[nodiscard]] ACCESSVDB_API std::vector<ToolSpec> namedTools(std::vector<ToolSpec> tools);

/// The parameters of a field with this tool alone: `params` with the tool's own values in their places.
[[nodiscard]] ACCESSVDB_API FieldParams toolParams(const ToolSpec& tool, FieldParams params);

/// "name value" pairs like FieldParams::describe(), for several tools: what they share, then what each has of its own.
/// @param tools  named
[[nodiscard]] ACCESSVDB_API std::string describeTools(const std::vector<ToolSpec>& tools, const FieldParams& params);

/// SHA-256 of all that makes a list of tools what it is, meshes, order and names included: "tools:" and 64 digits. Of
/// one tool ToolGeometry::sha256(). @param tools  named
[[nodiscard]] ACCESSVDB_API std::string toolListSha256(const std::vector<ToolSpec>& tools);

}  // namespace accessvdb
