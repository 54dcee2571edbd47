// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inverse of the tool kernel: in which directions does the tool cover a voxel at a given offset from the point?
/// There are few flips for the better (a few thousand voxels per scan), so it is cheaper to look up the directions of
/// each flip than the voxels of each direction.
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"
#include "points/point_store.h"

namespace accessvdb::internal {

class OffsetDirections {
 public:
  /// Memory limit of the table; beyond it, directions are checked one by one.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

  /// Empty if the table would exceed `most_bytes`, and for tools tested by samples (their voxels depend on where in its
  /// voxel the point lies).
  OffsetDirections(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes);

  [[nodiscard]] bool empty() const { return table_.empty(); }
  [[nodiscard]] const Index3& low() const { return low_; }  ///< box of all offsets, inclusive
  [[nodiscard]] const Index3& high() const { return high_; }

  /// @return the directions, or nullptr if no direction covers the offset
  [[nodiscard]] const std::uint64_t* at(const Index3& offset) const {
    std::size_t n = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t i = offset[axis] - low_[axis];
      if (i < 0 || i >= size_[axis]) return nullptr;
      n = n * static_cast<std::size_t>(size_[axis]) + static_cast<std::size_t>(i);
    }
    return table_.data() + n * words_;
  }
  [[nodiscard]] std::size_t words() const { return words_; }
  [[nodiscard]] const Index3& size() const { return size_; }
  [[nodiscard]] const std::vector<std::uint64_t>& table() const { return table_; }
  [[nodiscard]] std::uint64_t bytes() const { return table_.capacity() * sizeof(std::uint64_t); }

 private:
  Index3 low_ = {}, high_ = {}, size_ = {};
  std::size_t words_;
  std::vector<std::uint64_t> table_;  ///< [x][y][z][words]
};

}  // namespace accessvdb::internal
