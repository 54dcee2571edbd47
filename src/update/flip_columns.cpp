// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/flip_columns.h"

namespace accessvdb::internal {

bool FlipColumns::fill(const FlipSet& flips, const Index3& low, const Index3& high) {
  low_ = low;
  for (std::size_t axis = 0; axis < 3; ++axis) size_[axis] = high[axis] - low[axis] + 1;
  const std::size_t columns = static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]);
  column_kinds_.assign(columns, 0);
  kinds_.assign(columns * static_cast<std::size_t>(size_[2]), 0);
  changes_.resize(kinds_.size());
  return flips.forEachIn(low, high, [&](const Index3& leaf, std::uint32_t change, std::uint8_t kinds) {
    const std::size_t n = leafAt(leaf[0], leaf[1], leaf[2]);
    kinds_[n] = kinds;
    changes_[n] = change;
    std::uint8_t& column = column_kinds_[columnAt(leaf[0], leaf[1])];
    column = static_cast<std::uint8_t>(column | kinds);
  });
}

std::uint8_t FlipColumns::kindsIn(std::int32_t x, std::int32_t y, std::int32_t z_low, std::int32_t z_high) const {
  if (column_kinds_[columnAt(x, y)] == 0) return 0;
  std::uint8_t kinds = 0;
  const std::size_t first = leafAt(x, y, z_low);
  for (std::size_t n = 0; n <= static_cast<std::size_t>(z_high - z_low); ++n) {
    kinds = static_cast<std::uint8_t>(kinds | kinds_[first + n]);
  }
  return kinds;
}

}  // namespace accessvdb::internal
