// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool by cells of 4 x 4 x 4 voxels of the map, so that a few counts that the mirror keeps bound its collisions
/// (hostdev/cell_counts.h).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::internal {

/// Runs of direction d and phase n: runs[begin[d * kCellPhases + n] .. begin[that + 1]).
struct CellRuns {
  std::vector<kernels::CellRun> runs;
  std::vector<std::uint32_t> begin;  ///< [D x kCellPhases + 1]
};

/// See InnerRowsView.
struct InnerRows {
  std::vector<std::uint64_t> rows;
  std::vector<kernels::InnerBox> boxes;
  std::vector<kernels::RowTile> tiles;
  std::vector<std::uint32_t> tile_begin;

  /// @param inner  [D] the inner columns of each direction  @return empty where some are higher than 64 voxels
  static InnerRows make(std::span<const std::span<const kernels::VoxelColumn>> inner);
};

/// See ToolCellsView. Empty where it would take too much memory, and for thin tools and sample tools: that costs time
/// only.
struct ToolCells {
  /// What runs of cells may take; above it, searches do without them.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

  CellRuns inside, beside;
  std::vector<std::uint32_t> inner;  ///< [D]
  InnerRows rows;
  /// The tool's columns in the order in which they are best counted: those outside all cells first, near ones first.
  std::vector<kernels::VoxelColumn> columns;

  [[nodiscard]] bool empty() const { return inner.empty(); }

  /// @param tool  host memory
  static ToolCells make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes);
};

}  // namespace accessvdb::internal
