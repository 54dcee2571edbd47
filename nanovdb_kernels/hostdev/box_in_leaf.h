// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels of a leaf that are in a box.
#pragma once

#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// One word for each x, in which voxel (x, y, z) of the leaf has bit 8 y + z. The box has some of them.
class BoxInLeaf {
 public:
  /// @param leaf  voxel index >> 3  @param low, high  [voxels] of the box, inclusive
  ACCESSVDB_HOSTDEV BoxInLeaf(const std::int32_t* leaf, const std::int32_t* low, const std::int32_t* high) {
    const auto from = [&](int axis) {
      const std::int32_t first = low[axis] - leaf[axis] * 8;
      return first > 0 ? first : 0;
    };
    const auto to = [&](int axis) {
      const std::int32_t last = high[axis] - leaf[axis] * 8;
      return last < 7 ? last : 7;
    };
    constexpr std::uint64_t kEachRow = 0x0101010101010101u, kAll = ~std::uint64_t{0};
    const std::uint64_t row = (0xffu << from(2)) & (0xffu >> (7 - to(2)));
    plane_ = row * kEachRow & kAll << (8 * from(1)) & kAll >> (8 * (7 - to(1)));
    x_low_ = from(0), x_high_ = to(0);
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV int lastX() const { return x_high_; }
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint64_t wordAt(int x) const { return x < x_low_ || x > x_high_ ? 0 : plane_; }
  /// @param bits  [8] of a leaf
  [[nodiscard]] ACCESSVDB_HOSTDEV bool hasAnyOf(const std::uint64_t* bits) const {
    std::uint64_t any = 0;
    for (int x = x_low_; x <= x_high_; ++x) any |= bits[x] & plane_;
    return any != 0;
  }

 private:
  std::uint64_t plane_;
  int x_low_, x_high_;
};

}  // namespace accessvdb::kernels
