// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sixteen directions at a time must say what hostdev/known_levels.h says of eight, and a loop over single levels.
#include "update/known_rows.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

namespace accessvdb::internal {
namespace {

using Row = std::array<std::uint64_t, known_rows::kWords>;

unsigned byteOf(const Row& row, std::size_t direction) {
  return static_cast<unsigned>(row[direction / 8] >> (8 * (direction % 8))) & 0xffu;
}
void setByte(Row& row, std::size_t direction, unsigned value) {
  row[direction / 8] |= std::uint64_t{value} << (8 * (direction % 8));
}

TEST(KnownRows, SayAsLevelsOneByOneWhichDirectionsAreWorse) {
  std::mt19937_64 random(1);
  int worse = 0, not_worse = 0, by_corridor = 0, on_the_edge = 0;
  for (int round = 0; round < 2000; ++round) {
    Row levels = {}, lowest = {};
    for (std::size_t d = 0; d < 64; ++d) {
      const auto least = static_cast<unsigned>(1 + random() % 128);
      // Often just at or below the lowest level, and at both ends of what a byte holds.
      const unsigned choices[] = {least - 1, least, 0, 127, static_cast<unsigned>(random() % 128)};
      const unsigned level = std::min(choices[random() % 5], 127u);
      const unsigned arm = random() % 4 == 0 ? 0x80u : 0;
      setByte(levels, d, level | arm);
      setByte(lowest, d, least);
    }
    const std::uint64_t found = known_rows::worse(levels.data(), lowest.data());
    for (std::size_t d = 0; d < 64; ++d) {
      const unsigned byte = byteOf(levels, d), level = byte & 0x7fu, least = byteOf(lowest, d);
      const bool expected = (byte & 0x80u) != 0 || level >= least;
      ASSERT_EQ((found >> d & 1u) != 0, expected) << "level " << level << " of " << least << ", byte " << byte;
      (expected ? worse : not_worse) += 1;
      by_corridor += expected && level < least ? 1 : 0;
      on_the_edge += level == least || level + 1 == least ? 1 : 0;
    }
    for (std::size_t w = 0; w < known_rows::kWords; ++w) {
      ASSERT_EQ(found >> (8 * w) & 0xffu, kernels::known_word::worse(levels[w], lowest[w]));
    }
  }
  EXPECT_GT(worse, 10000);
  EXPECT_GT(not_worse, 10000);
  EXPECT_GT(by_corridor, 1000);
  EXPECT_GT(on_the_edge, 10000);
}

TEST(KnownRows, LowerLevelsButNotCorridors) {
  std::mt19937_64 random(2);
  int to_nothing = 0, left = 0;
  for (int round = 0; round < 2000; ++round) {
    Row levels = {}, steps = {};
    for (std::size_t d = 0; d < 64; ++d) {
      const auto level = static_cast<unsigned>(random() % 128);
      const unsigned choices[] = {0, level, level + 1, 127, static_cast<unsigned>(random() % 128)};
      setByte(levels, d, level | (random() % 3 == 0 ? 0x80u : 0));
      setByte(steps, d, std::min(choices[random() % 5], 127u));
    }
    Row lower = levels;
    known_rows::lower(lower.data(), steps.data());
    for (std::size_t d = 0; d < 64; ++d) {
      const unsigned level = byteOf(levels, d) & 0x7fu, less = byteOf(steps, d);
      const unsigned expected = level > less ? level - less : 0;
      ASSERT_EQ(byteOf(lower, d) & 0x7fu, expected) << level << " less " << less;
      ASSERT_EQ(byteOf(lower, d) & 0x80u, byteOf(levels, d) & 0x80u);
      to_nothing += level > 0 && expected == 0 ? 1 : 0;
      left += expected > 0 && less > 0 ? 1 : 0;
    }
    for (std::size_t w = 0; w < known_rows::kWords; ++w) {
      ASSERT_EQ(lower[w], kernels::known_word::lowered(levels[w], steps[w]));
    }
  }
  EXPECT_GT(to_nothing, 10000);
  EXPECT_GT(left, 10000);
}

}  // namespace
}  // namespace accessvdb::internal
