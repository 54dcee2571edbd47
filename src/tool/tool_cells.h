// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool by cells of 4 x 4 x 4 voxels of the map, so that a few counts that the mirror keeps bound its collisions
/// (hostdev/cell_counts.h).
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::internal {

/// Runs of direction d and phase n: runs[begin[d * kCellPhases + n] .. begin[that + 1]).
struct CellRuns {
  std::vector<kernels::CellRun> runs;
  std::vector<std::uint32_t> begin;  ///< [D x kCellPhases + 1]
};

/// See ToolCellsView. Empty where it would take too much memory, and for thin tools and sample tools: that costs time
/// only.
struct ToolCells {
  CellRuns inside, beside;
  std::vector<std::uint32_t> inner;  ///< [D]
  /// The tool's columns in the order in which they are best counted: those outside all cells first, near ones first.
  std::vector<kernels::VoxelColumn> columns;

  [[nodiscard]] bool empty() const { return inner.empty(); }

  /// @param tool  host memory
  static ToolCells make(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes);
};

}  // namespace accessvdb::internal
