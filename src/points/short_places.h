// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers for the places (placeOf) within a box of leaves, in the same order, but of as few bits as the box allows:
/// those of a scan are sorted in less time.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "points/surface_index.h"

namespace accessvdb::internal {

class ShortPlaces {
 public:
  /// Leaves from `low` to `high`; none at first.
  struct Box {
    Index3 low, high;
    Box() {
      low.fill(std::numeric_limits<std::int32_t>::max());
      high.fill(std::numeric_limits<std::int32_t>::min());
    }
    void add(const Index3& leaf) { add(leaf, leaf); }
    void add(const Box& other) { add(other.low, other.high); }

   private:
    void add(const Index3& other_low, const Index3& other_high) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], other_low[axis]);
        high[axis] = std::max(high[axis], other_high[axis]);
      }
    }
  };

  /// @param leaves  with one at least
  explicit ShortPlaces(const Box& leaves) : first_(placeOf({8 * leaves.low[0], 8 * leaves.low[1], 8 * leaves.low[2]})) {
    const auto bitsAlong = [&](std::size_t axis) {
      return std::bit_width(static_cast<std::uint32_t>(leaves.high[axis] - leaves.low[axis]));
    };
    shift_y_ = kBitsInLeaf + bitsAlong(2);
    shift_x_ = shift_y_ + bitsAlong(1);
    bits_ = shift_x_ + bitsAlong(0);
  }

  [[nodiscard]] int bits() const { return bits_; }
  /// @param place  of a voxel of these leaves
  [[nodiscard]] std::uint64_t operator()(std::uint64_t place) const {
    // No coordinate is below that of the first leaf, so none borrows from another.
    const std::uint64_t from_first = place - first_;
    const std::uint64_t z = from_first & ((std::uint64_t{1} << kAxisShift) - 1);
    const std::uint64_t y = from_first >> kAxisShift & ((std::uint64_t{1} << kLeafBits) - 1);
    return from_first >> (kAxisShift + kLeafBits) << shift_x_ | y << shift_y_ | z;
  }

 private:
  static constexpr int kBitsInLeaf = 9, kLeafBits = 18, kAxisShift = kBitsInLeaf + kLeafBits;  ///< as in placeOf()

  std::uint64_t first_;
  int shift_y_, shift_x_, bits_;
};

}  // namespace accessvdb::internal
