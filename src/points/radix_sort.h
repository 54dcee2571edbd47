// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sorts items with whole numbers as keys, on one thread. A scan's returns are few enough that waking other threads up
/// takes longer than this.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace accessvdb::internal {

/// Stable: items with equal keys stay in their order. Digits that are the same in all keys cost nothing.
/// @param key  of an item, std::uint64_t  @param spare  memory for a copy of the items, of any size; kept by the caller
template <typename Item, typename Key>
void radixSort(std::vector<Item>& items, std::vector<Item>& spare, const Key& key) {
  constexpr int kBits = 11;  // the counts of a digit fit into the first-level cache
  constexpr std::size_t kValues = std::size_t{1} << kBits;
  if (items.empty()) return;
  std::uint64_t differ = 0;
  for (const Item& item : items) differ |= key(item) ^ key(items.front());
  spare.resize(items.size());
  for (int shift = 0; shift < 64; shift += kBits) {
    if ((differ >> shift & (kValues - 1)) == 0) continue;
    const auto digit = [&](const Item& item) { return static_cast<std::size_t>(key(item) >> shift & (kValues - 1)); };
    std::array<std::size_t, kValues> place = {};
    for (const Item& item : items) ++place[digit(item)];
    std::size_t before = 0;
    for (std::size_t& first : place) before += std::exchange(first, before);
    for (const Item& item : items) spare[place[digit(item)]++] = item;
    std::swap(items, spare);
  }
}

}  // namespace accessvdb::internal
