// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of a block that are in a box of voxels.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "points/surface_index.h"

namespace accessvdb::internal {

/// The voxels of a leaf that are in a box, one word for each x. The box has some of them.
class BoxInLeaf {
 public:
  /// @param low, high  inclusive
  BoxInLeaf(const Index3& leaf, const Index3& low, const Index3& high) {
    const auto from = [&](std::size_t axis) { return std::max(0, low[axis] - leaf[axis] * 8); };
    const auto to = [&](std::size_t axis) { return std::min(7, high[axis] - leaf[axis] * 8); };
    constexpr std::uint64_t kEachRow = 0x0101010101010101u, kAll = ~std::uint64_t{0};
    const std::uint64_t row = (0xffu << from(2)) & (0xffu >> (7 - to(2)));
    plane_ = row * kEachRow & kAll << (8 * from(1)) & kAll >> (8 * (7 - to(1)));
    x_low_ = from(0), x_high_ = to(0);
  }
  [[nodiscard]] int lastX() const { return x_high_; }
  [[nodiscard]] std::uint64_t wordAt(int x) const { return x < x_low_ || x > x_high_ ? 0 : plane_; }
  [[nodiscard]] bool hasAnyOf(const LeafBits& bits) const {
    std::uint64_t any = 0;
    for (int x = x_low_; x <= x_high_; ++x) any |= bits[static_cast<std::size_t>(x)] & plane_;
    return any != 0;
  }

 private:
  std::uint64_t plane_;
  int x_low_, x_high_;
};

/// Calls visit(id) for the points of a block that are in a box of voxels. @param low, high  inclusive
template <typename Visit>
void forEachIdInBox(const PointBlock& block, const Index3& low, const Index3& high, const Visit& visit) {
  const BoxInLeaf box(block.leaf, low, high);
  const std::uint32_t* id = block.ids.data();  // of the next set bit
  for (int x = 0; x <= box.lastX(); ++x) {
    const std::uint64_t occupied = block.occupied[static_cast<std::size_t>(x)], wanted = occupied & box.wordAt(x);
    if (wanted == 0) {
      id += std::popcount(occupied);
      continue;
    }
    // There are only a few bits, so going through them is faster than counting those below each one.
    for (std::uint64_t bits = occupied; bits != 0; bits &= bits - 1, ++id) {
      if ((wanted & bits & -bits) != 0) visit(*id);
    }
  }
}

}  // namespace accessvdb::internal
