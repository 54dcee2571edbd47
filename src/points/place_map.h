// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Numbers by position: a flat hash table that only grows. Many threads may look up at once; inserting is not
/// thread-safe. Unlike ChunkedArray it moves its contents when it grows, which is cheap: there is one entry per few
/// hundred points.
#pragma once

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "hostdev/place_key.h"

namespace accessvdb::internal {

class PlaceMap {
 public:
  static constexpr std::uint32_t kAbsent = ~std::uint32_t{0};

  /// @param place  coordinates within +-2^20. @return its number or kAbsent
  [[nodiscard]] std::uint32_t find(const std::array<std::int32_t, 3>& place) const {
    if (slots_.empty()) return kAbsent;
    return slots_[slotOf(kernels::placeKey(place[0], place[1], place[2]))].number;
  }

  /// @param number  assigned to a new place. @return its number, and whether it is new
  std::pair<std::uint32_t, bool> insert(const std::array<std::int32_t, 3>& place, std::uint32_t number) {
    if (2 * (count_ + 1) > slots_.size()) grow();
    Slot& slot = slots_[slotOf(kernels::placeKey(place[0], place[1], place[2]))];
    if (slot.number != kAbsent) return {slot.number, false};
    slot = {kernels::placeKey(place[0], place[1], place[2]), number};
    ++count_;
    return {number, true};
  }

  [[nodiscard]] std::uint64_t bytes() const { return slots_.capacity() * sizeof(Slot); }

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::uint32_t number = kAbsent;
  };
  /// The key's slot, or the free slot where it belongs.
  [[nodiscard]] std::size_t slotOf(std::uint64_t key) const {
    const std::size_t mask = slots_.size() - 1;
    std::uint64_t hash = (key ^ key >> 31) * 0x9e3779b97f4a7c15ull;
    hash ^= hash >> 29;
    std::size_t slot = hash & mask;
    while (slots_[slot].number != kAbsent && slots_[slot].key != key) slot = (slot + 1) & mask;
    return slot;
  }
  void grow() {
    const std::vector<Slot> before = std::exchange(slots_, std::vector<Slot>(slots_.empty() ? 64 : 2 * slots_.size()));
    for (const Slot& slot : before) {
      if (slot.number != kAbsent) slots_[slotOf(slot.key)] = slot;
    }
  }

  std::vector<Slot> slots_;  ///< size is a power of two; at most half are in use
  std::size_t count_ = 0;
};

}  // namespace accessvdb::internal
