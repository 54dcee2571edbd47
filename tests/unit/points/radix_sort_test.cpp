// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/radix_sort.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace accessvdb::internal {
namespace {

struct Item {
  std::uint64_t key;
  std::uint32_t before;  ///< its place
  bool operator==(const Item&) const = default;
};

std::vector<Item> itemsWith(const std::vector<std::uint64_t>& keys) {
  std::vector<Item> items;
  for (const std::uint64_t key : keys) items.push_back({key, static_cast<std::uint32_t>(items.size())});
  return items;
}

void expectSorted(const std::vector<std::uint64_t>& keys, std::vector<Item>& spare) {
  std::vector<Item> expected = itemsWith(keys), sorted = expected;
  std::stable_sort(expected.begin(), expected.end(), [](const Item& a, const Item& b) { return a.key < b.key; });
  radixSort(sorted, spare, [](const Item& item) { return item.key; });
  EXPECT_EQ(sorted, expected);
}

TEST(RadixSort, IsAStableSort) {
  std::mt19937_64 random(1);
  std::vector<Item> spare;
  // All bits, few values, one digit in the middle, two digits that end with the highest bit, that bit with others.
  for (const std::uint64_t mask :
       {~std::uint64_t{0}, std::uint64_t{7}, std::uint64_t{0x3ff} << 30, std::uint64_t{0x1ffff} << 47,
        std::uint64_t{3} << 62, std::uint64_t{1} << 63 | 1, std::uint64_t{0}}) {
    for (const std::size_t count : {0u, 1u, 2u, 3u, 1000u, 20'000u}) {
      std::vector<std::uint64_t> keys(count);
      for (std::uint64_t& key : keys) key = random() & mask;
      SCOPED_TRACE(testing::Message() << mask << ", " << count);
      expectSorted(keys, spare);
    }
  }
}

}  // namespace
}  // namespace accessvdb::internal
