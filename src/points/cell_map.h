// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers of cells by place: a flat hash table that only grows. Looking up is safe from many threads, inserting is
/// not. It moves what it holds where it grows, unlike ChunkedArray: there is one cell for some hundred points, so that
/// is little.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "hostdev/place_key.h"

namespace accessvdb::internal {

class CellMap {
 public:
  static constexpr std::uint32_t kNoCell = ~std::uint32_t{0};

  /// @param cell  coordinates within +-2^20. @return its number or kNoCell
  [[nodiscard]] std::uint32_t find(const std::array<std::int32_t, 3>& cell) const {
    if (slots_.empty()) return kNoCell;
    return slots_[slotOf(kernels::placeKey(cell[0], cell[1], cell[2]))].number;
  }

  /// @param number  what a new cell gets. @return the cell's number, and whether it is new
  std::pair<std::uint32_t, bool> insert(const std::array<std::int32_t, 3>& cell, std::uint32_t number) {
    if (2 * (count_ + 1) > slots_.size()) grow();
    Slot& slot = slots_[slotOf(kernels::placeKey(cell[0], cell[1], cell[2]))];
    if (slot.number != kNoCell) return {slot.number, false};
    slot = {kernels::placeKey(cell[0], cell[1], cell[2]), number};
    ++count_;
    return {number, true};
  }

  [[nodiscard]] std::uint64_t bytes() const { return slots_.capacity() * sizeof(Slot); }

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t number = kNoCell;
  };
  /// That of the key, or the free one where it belongs.
  [[nodiscard]] std::size_t slotOf(std::uint64_t key) const {
    const std::size_t mask = slots_.size() - 1;
    std::uint64_t hash = (key ^ key >> 31) * 0x9e3779b97f4a7c15ull;
    hash ^= hash >> 29;
    std::size_t slot = hash & mask;
    while (slots_[slot].number != kNoCell && slots_[slot].key != key) slot = (slot + 1) & mask;
    return slot;
  }
  void grow() {
    const std::vector<Slot> before = std::exchange(slots_, std::vector<Slot>(slots_.empty() ? 64 : 2 * slots_.size()));
    for (const Slot& slot : before) {
      if (slot.number != kNoCell) slots_[slotOf(slot.key)] = slot;
    }
  }

  std::vector<Slot> slots_;  ///< a power of two, at most half of them taken
  std::size_t count_ = 0;
};

}  // namespace accessvdb::internal
