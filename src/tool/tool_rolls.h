// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How a tool may roll about its body, and its symmetry about it.
#pragma once

#include "accessvdb/params.h"
#include "accessvdb/tool_geometry.h"

namespace accessvdb::internal {

/// A tool that looks the same after 1 / n of a turn, n at least this, counts as turned on a lathe: it needs no rolls.
inline constexpr int kTurnedFold = 12;
/// Rolls over a whole turn where they are chosen by rule.
inline constexpr int kRollsPerTurn = 12;
/// Most rolls: the best one is stored as a byte, and tables grow with them.
inline constexpr int kMostRolls = 64;

/// The largest n up to 360 for which the tool looks the same after 1 / n of a turn about its x axis: each vertex lands
/// on a vertex, within a thousandth of the largest radius, and the surface has the moments of such a symmetry. 1: none.
/// If this were too large, fewer rolls would be tried, which can only take access away.
[[nodiscard]] int foldAboutBody(const ToolGeometry& tool);

/// Rolls 0 .. count - 1, evenly over 1 / fold of a turn.
struct ToolRolls {
  int count = 1;
  int fold = 1;
};
/// @param approach  ApproachParams::rolls may still be 0, the rule
[[nodiscard]] ToolRolls toolRolls(const ToolGeometry& tool, const ApproachParams& approach);

/// An orientation, turned about the tool's body.
[[nodiscard]] ToolOrientation rolledBy(const ToolOrientation& orientation, const ToolRolls& rolls, int roll);

}  // namespace accessvdb::internal
