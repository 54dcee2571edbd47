// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sorts items with whole numbers as keys, on one thread. A scan's returns are few enough that waking other threads up
/// takes longer than this.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace accessvdb::internal {

/// Stable: items with equal keys stay in their order. Takes the longer, the more bits lie between the lowest and the
/// highest one that differ among the keys.
/// @param items  fewer than 2^32  @param key  of an item, std::uint64_t
/// @param spare  memory for a copy of the items, of any size; kept by the caller
template <typename Item, typename Key>
void radixSort(std::vector<Item>& items, std::vector<Item>& spare, const Key& key) {
  constexpr int kMostBits = 12;  // the counts of a digit fit into the first-level cache
  std::uint64_t differ = 0;
  for (const Item& item : items) differ |= key(item) ^ key(items.front());
  if (differ == 0) return;
  const int lowest = std::countr_zero(differ), bits = std::bit_width(differ) - lowest;
  const int digits = (bits + kMostBits - 1) / kMostBits, bits_of_digit = (bits + digits - 1) / digits;
  const std::size_t values = std::size_t{1} << bits_of_digit;
  spare.resize(items.size());
  for (int n = 0, shift = lowest; n < digits; ++n, shift += bits_of_digit) {
    const auto digit = [&](const Item& item) { return static_cast<std::size_t>(key(item) >> shift & (values - 1)); };
    std::array<std::uint32_t, std::size_t{1} << kMostBits> place;
    std::fill_n(place.begin(), values, 0);
    for (const Item& item : items) ++place[digit(item)];
    std::uint32_t before = 0;
    for (std::uint32_t& first : std::span(place).first(values)) before += std::exchange(first, before);
    for (const Item& item : items) spare[place[digit(item)]++] = item;
    std::swap(items, spare);
  }
}

}  // namespace accessvdb::internal
