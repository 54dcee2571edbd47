// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/window_margins.h"

#include <algorithm>
#include <cmath>

#include "change/gone_cells.h"
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

WindowMargins windowMargins(const ToolKernel& tool, const FieldParams& resolved) {
  const TsdfParams& t = resolved.tsdf;
  WindowMargins margins;
  margins.map = 1;  // the weights around a point
  for (std::size_t axis = 0; axis < 2; ++axis) {
    margins.map = std::max({margins.map, std::abs(tool.min_ijk[axis]), std::abs(tool.max_ijk[axis])});
  }
  margins.map = std::max(margins.map, voxels(armDistances(resolved).back(), resolved) + 1);
  margins.height = std::max({std::abs(tool.min_ijk[2]), std::abs(tool.max_ijk[2]), margins.map});
  const double band_m = t.cleared_end_tau * t.truncation_distance_m + t.cleared_radius_voxels * t.voxel_size_m;
  double returns_m = std::max(t.truncation_distance_m, band_m);
  if (resolved.change.mode != ChangeMode::Off) {
    // A voxel's votes depend on what the map held where a return within tau lies, and that on returns within tau of it.
    returns_m = std::max(returns_m, 2 * t.truncation_distance_m + t.voxel_size_m);
  }
  margins.returns = voxels(returns_m, resolved) + kRounding;
  margins.neighbours = voxels(neighbourRadius_m(t.voxel_size_m), resolved) + kRounding;
  const double competitors_voxels = surfaceChoice(resolved).reachVoxels();
  margins.neighbours = std::max(margins.neighbours, static_cast<std::int32_t>(std::ceil(competitors_voxels)));
  if (resolved.change.mode == ChangeMode::Full) {
    // Whether anything is left to open around a cell: in the leaves of its shadow, by the cells beside those.
    margins.evidence = kCellEdge * (shadowCells(t) + 2);
  }
  return margins;
}

std::int32_t WindowMargins::influence() const {
  return std::max(std::max(map, height) + returns, neighbours) + kGoneCells;
}

WindowMargins unionOf(const WindowMargins& a, const WindowMargins& b) {
  return {std::max(a.map, b.map), std::max(a.returns, b.returns), std::max(a.neighbours, b.neighbours),
          std::max(a.height, b.height), std::max(a.evidence, b.evidence)};
}

VoxelColumnBox coreOf(const FieldWindow& window) { return {window.core_low, window.core_high}; }

VoxelColumnBox returnsOf(const FieldWindow& window, const WindowMargins& margins) {
  VoxelColumnBox box = coreOf(window);
  // Whole leaves of the map have to be exact: a mirror's cell counts its voxels together.
  const std::int32_t leaves = (std::max(margins.map, margins.evidence) + kLeafEdge - 1) / kLeafEdge * kLeafEdge;
  const std::int32_t margin = std::max(leaves + margins.returns, margins.neighbours);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    box.low[axis] -= margin;
    box.high[axis] += margin;
  }
  return box;
}

}  // namespace accessvdb::internal
