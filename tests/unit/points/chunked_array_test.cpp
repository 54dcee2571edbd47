// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/chunked_array.h"

#include <gtest/gtest.h>

#include <array>

namespace accessvdb::internal {
namespace {

TEST(ChunkedArray, GrowsWithoutMovingAnything) {
  using Three = std::array<std::uint32_t, 3>;  // does not divide a chunk
  ChunkedArray<Three> array;
  EXPECT_TRUE(array.empty());
  EXPECT_EQ(array.bytes(), 0u);
  std::vector<const Three*> places;
  std::vector<Three> expected;
  constexpr auto kChunk = static_cast<std::uint32_t>(ChunkedArray<Three>::kChunk);
  const std::uint32_t sizes[] = {1, 2, 2, kChunk - 1, kChunk, kChunk + 1, 3 * kChunk, 5 * kChunk + 7};
  for (const std::uint32_t size : sizes) {
    array.grow(size, {size, 1, 2});
    ASSERT_EQ(array.size(), size);
    expected.resize(size, Three{size, 1, 2});
    while (places.size() < size) places.push_back(&array[places.size()]);
    for (std::uint32_t n = 0; n < size; ++n) {
      ASSERT_EQ(&array[n], places[n]);
      ASSERT_EQ(array[n], expected[n]);
    }
    array[size / 2] = expected[size / 2] = {size, size, size};
    ASSERT_GE(array.bytes(), size * sizeof(Three));
    ASSERT_LE(array.bytes(), (size + kChunk) * sizeof(Three) + 1000);
  }
  array.grow(3, {9, 9, 9});  // it is longer
  EXPECT_EQ(array.size(), expected.size());
  array.push_back({4, 5, 6});
  EXPECT_EQ(array[expected.size()], (Three{4, 5, 6}));
}

TEST(ChunkedArray, ZeroesWhatHasNoOtherValue) {
  ChunkedArray<std::uint8_t> array;
  for (std::size_t size = 1; size < 200'000; size = 3 * size + 1) {
    array.grow(size);
    for (std::size_t n = 0; n < size; ++n) ASSERT_EQ(array[n], n % 7 == 0 && n < size / 3 ? 1 : 0) << n;
    for (std::size_t n = 0; n < size; n += 7) array[n] = 1;
  }
}

}  // namespace
}  // namespace accessvdb::internal
