// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far around a point its label depends on the map, on other points and on returns: the only place that computes
/// this. A rule that reaches farther has to be added here, or tiles no longer equal one piece (tests/property,
/// tiles_equal_one_piece).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "accessvdb/field_window.h"
#include "accessvdb/params.h"
#include "points/voxel_column_box.h"

namespace accessvdb::internal {

struct ToolKernel;

/// In voxels, along x and y unless it says otherwise.
struct WindowMargins {
  std::int32_t map = 0;      ///< from a point to the farthest voxel that its score or weight reads
  std::int32_t returns = 0;  ///< from a return to the farthest voxel that it changes
  /// From a point to the farthest neighbour of its normal and its joined views, and to the farthest with which it
  /// competes for being scored.
  std::int32_t neighbours = 0;
  std::int32_t height = 0;    ///< as map, along z
  std::int32_t evidence = 0;  ///< from a cell of ChangeMode::Full to the farthest voxel that it is judged by

  /// What has gone is judged by cells of 4 voxels and those beside them (change/gone_cells.h), and one that opens
  /// counts for those beside it.
  static constexpr std::int32_t kGoneCells = 12;
  /// Along any axis: from a return to the farthest point whose label may depend on it.
  [[nodiscard]] std::int32_t influence() const;
};
WindowMargins windowMargins(const ToolKernel& tool, const FieldParams& resolved);
/// Of a field with several tools.
WindowMargins unionOf(const WindowMargins& a, const WindowMargins& b);

VoxelColumnBox coreOf(const FieldWindow& window);
/// Voxels whose returns a window needs.
VoxelColumnBox returnsOf(const FieldWindow& window, const WindowMargins& margins);

}  // namespace accessvdb::internal
