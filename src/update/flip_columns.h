// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flips in a box of leaves, as columns of bits: which leaves of a column have a flip of a kind. The blocks of a
/// cell share it, because they read mostly the same leaves.
#pragma once

#include <cstdint>
#include <vector>

#include "update/flip_set.h"

namespace accessvdb::internal {

class FlipColumns {
 public:
  /// @param low, high  leaves, inclusive. @return false if nothing flipped in the box
  bool fill(const FlipSet& flips, const Index3& low, const Index3& high);

  /// Whether any leaf of a column, in the box, has a flip.
  [[nodiscard]] bool anyIn(std::int32_t x, std::int32_t y) const { return column_kinds_[columnAt(x, y)] != 0; }
  /// Whether the leaves (x, y, z_low .. z_high), all in the box, have a flip of a kind. @return bit (1 << kind) each
  [[nodiscard]] std::uint8_t kindsIn(std::int32_t x, std::int32_t y, std::int32_t z_low, std::int32_t z_high) const;

  /// Calls visit(z, change) for each of these leaves with a flip of a kind.
  template <typename Visit>
  void forEach(std::int32_t x, std::int32_t y, std::int32_t z_low, std::int32_t z_high, FlipKind kind,
               const Visit& visit) const {
    for (std::int32_t z = z_low; z <= z_high; ++z) {
      const std::size_t n = leafAt(x, y, z);
      if ((kinds_[n] & bitOf(kind)) != 0) visit(z, changes_[n]);
    }
  }

 private:
  [[nodiscard]] std::size_t columnAt(std::int32_t x, std::int32_t y) const {
    return static_cast<std::size_t>(x - low_[0]) * static_cast<std::size_t>(size_[1]) +
           static_cast<std::size_t>(y - low_[1]);
  }
  [[nodiscard]] std::size_t leafAt(std::int32_t x, std::int32_t y, std::int32_t z) const {
    return columnAt(x, y) * static_cast<std::size_t>(size_[2]) + static_cast<std::size_t>(z - low_[2]);
  }

  Index3 low_ = {}, size_ = {};
  std::vector<std::uint8_t> column_kinds_;  ///< [x][y] of all its leaves
  std::vector<std::uint8_t> kinds_;         ///< [x][y][z]
  std::vector<std::uint32_t> changes_;      ///< [x][y][z] index into FlipSet::changes()
};

}  // namespace accessvdb::internal
