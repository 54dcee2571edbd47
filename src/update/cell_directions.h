// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A coarse inverse of the tool kernel: which directions may cover a cell of 4 x 4 x 4 voxels from some point of a
/// group of blocks? Used for bounds that hold for all points of a group. Yaw directions are stored as the smallest arc
/// that contains them: extra directions cost time but change no result. Others are stored as a set.
#pragma once

#include <cstdint>
#include <vector>

#include "launch/exact_updater.h"
#include "points/point_store.h"

namespace accessvdb::internal {

class CellDirections {
 public:
  /// While a table is made, it takes a mask per entry, whatever it keeps.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

  /// Of a wide set (kernels::isWide), direction 0 stands for all of them.
  /// Empty if the masks would exceed `most_bytes`, and for tools tested by samples (their voxels depend on where in its
  /// voxel the point lies). @param group_log2  same as for LeafFootprint
  /// @param as_sets  for directions of any kind; else they are yaws in order
  CellDirections(const kernels::ToolKernelView& tool, int num_directions, int group_log2, bool as_sets = false,
                 std::uint64_t most_bytes = kMostBytes);

  [[nodiscard]] bool empty() const { return table_.empty() && sets_.empty(); }
  /// Box of all offsets, in cells from the first cell of the group.
  [[nodiscard]] const Index3& low() const { return low_; }
  [[nodiscard]] const Index3& size() const { return size_; }
  [[nodiscard]] const std::vector<kernels::DirectionArc>& table() const { return table_; }  ///< [x][y][z]; of yaws
  [[nodiscard]] const std::vector<DirectionMask>& sets() const { return sets_; }            ///< [x][y][z]; of others
  [[nodiscard]] std::uint64_t bytes() const {
    return table_.capacity() * sizeof(kernels::DirectionArc) + sets_.capacity() * sizeof(DirectionMask);
  }

 private:
  Index3 low_ = {}, size_ = {};
  std::vector<kernels::DirectionArc> table_;
  std::vector<DirectionMask> sets_;
};

}  // namespace accessvdb::internal
