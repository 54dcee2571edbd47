// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool kernel read backwards: which directions does the tool cover a voxel with, that lies at an offset from the
/// point? Flips for the better are few (some thousand voxels a scan), so it is cheaper to ask each flip for its
/// directions than each direction for its voxels.
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"
#include "points/point_store.h"

namespace accessvdb::internal {

class OffsetDirections {
 public:
  /// Memory that the table may take; above it, directions are asked one by one.
  static constexpr std::uint64_t kMostBytes = std::uint64_t{256} << 20;

  /// Empty where the table would exceed `most_bytes`, or for tools tested by samples (their voxels depend on where in
  /// its voxel the point lies).
  OffsetDirections(const kernels::ToolKernelView& tool, int num_directions, std::uint64_t most_bytes);

  [[nodiscard]] bool empty() const { return table_.empty(); }
  [[nodiscard]] const Index3& low() const { return low_; }  ///< box of all offsets, inclusive
  [[nodiscard]] const Index3& high() const { return high_; }

  /// @return the directions, or nullptr where no direction covers the offset
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
