// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A coarse inverse of the tool kernel: which directions may cover a cell of 4 x 4 x 4 voxels from some point of a
/// group of blocks? Used for bounds that hold for all points of a group. The directions are stored as the smallest arc
/// that contains them: extra directions cost time but change no result.
#pragma once

#include <cstdint>
#include <vector>

#include "launch/exact_updater.h"
#include "points/point_store.h"

namespace accessvdb::internal {

class CellDirections {
 public:
  /// Empty if the table would exceed `most_bytes`, and for tools tested by samples (their voxels depend on where in its
  /// voxel the point lies). @param group_log2  same as for LeafFootprint
  CellDirections(const kernels::ToolKernelView& tool, int num_directions, int group_log2, std::uint64_t most_bytes);

  [[nodiscard]] bool empty() const { return table_.empty(); }
  /// Box of all offsets, in cells from the first cell of the group.
  [[nodiscard]] const Index3& low() const { return low_; }
  [[nodiscard]] const Index3& size() const { return size_; }
  [[nodiscard]] const std::vector<kernels::DirectionArc>& table() const { return table_; }  ///< [x][y][z]

 private:
  Index3 low_ = {}, size_ = {};
  std::vector<kernels::DirectionArc> table_;
};

}  // namespace accessvdb::internal
