// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/window_reach.h"

#include <algorithm>
#include <cmath>

#include "field/tools/scoring_setup.h"
#include "points/neighbourhood.h"
#include "tool/tool_kernel.h"

namespace accessvdb::internal {
namespace {

/// A return and its voxel, and a point and its mean position, are at most a voxel apart; the other voxel is for bounds
/// that are rounded.
constexpr std::int32_t kRounding = 2;
constexpr std::int32_t kLeafEdge = 8;

std::int32_t voxels(double length_m, const FieldParams& resolved) {
  return static_cast<std::int32_t>(std::ceil(length_m / resolved.tsdf.voxel_size_m));
}

}  // namespace

WindowReach windowReach(const ToolKernel& tool, const FieldParams& resolved) {
  const TsdfParams& t = resolved.tsdf;
  WindowReach reach;
  reach.map = 1;  // the weights around a point
  for (std::size_t axis = 0; axis < 2; ++axis) {
    reach.map = std::max({reach.map, std::abs(tool.min_ijk[axis]), std::abs(tool.max_ijk[axis])});
  }
  reach.map = std::max(reach.map, voxels(armDistances(resolved).back(), resolved) + 1);
  reach.height = std::max({std::abs(tool.min_ijk[2]), std::abs(tool.max_ijk[2]), reach.map});
  const double band_m = t.cleared_end_tau * t.truncation_distance_m + t.cleared_radius_voxels * t.voxel_size_m;
  double returns_m = std::max(t.truncation_distance_m, band_m);
  if (resolved.change.mode != ChangeMode::Off) {
    // A voxel's votes depend on what the map held where a return within tau lies, and that on returns within tau of it.
    returns_m = std::max(returns_m, 2 * t.truncation_distance_m + t.voxel_size_m);
  }
  reach.returns = voxels(returns_m, resolved) + kRounding;
  reach.neighbours = voxels(neighbourRadius_m(t.voxel_size_m), resolved) + kRounding;
  return reach;
}

std::int32_t WindowReach::influence() const {
  return std::max(std::max(map, height) + returns, neighbours) + kGoneCells;
}

WindowReach unionOf(const WindowReach& a, const WindowReach& b) {
  return {std::max(a.map, b.map), std::max(a.returns, b.returns), std::max(a.neighbours, b.neighbours),
          std::max(a.height, b.height)};
}

VoxelColumnBox coreOf(const FieldWindow& window) { return {window.core_low, window.core_high}; }

VoxelColumnBox returnsOf(const FieldWindow& window, const WindowReach& reach) {
  VoxelColumnBox box = coreOf(window);
  // Whole leaves of the map have to be exact: a mirror's cell counts its voxels together.
  const std::int32_t leaves = (reach.map + kLeafEdge - 1) / kLeafEdge * kLeafEdge;
  const std::int32_t margin = std::max(leaves + reach.returns, reach.neighbours);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    box.low[axis] -= margin;
    box.high[axis] += margin;
  }
  return box;
}

}  // namespace accessvdb::internal
