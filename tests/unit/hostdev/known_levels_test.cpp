// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Levels must never say more than was counted; how close they come costs time only.
#include "hostdev/known_levels.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

namespace accessvdb {
namespace {

using kernels::KnownLevels;

constexpr std::array<int, 9> kLimits = {1, 2, 5, 15, 16, 39, 280, 2128, 65535};

TEST(KnownLevels, NeverSayMoreThanWasCounted) {
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    for (std::size_t n = 1; n < 16; ++n) ASSERT_LT(levels.least[n - 1], levels.least[n]) << limit << " level " << n;
    for (int collisions = 0; collisions < 70000; ++collisions) {
      const std::uint32_t level = levels.levelOf(collisions);
      ASSERT_LT(level, KnownLevels::kArmBlocked);
      ASSERT_LE(levels.least[level], collisions) << limit;
      if (level + 1 < KnownLevels::kArmBlocked) {
        ASSERT_GT(levels.least[level + 1], collisions) << limit;
      }
    }
  }
}

TEST(KnownLevels, TheLowestLevelThatIsEnoughIsEnough) {
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    for (int needed = 1; needed < 140000; ++needed) {
      const std::uint32_t lowest = levels.lowestWith(needed);
      ASSERT_LE(lowest, KnownLevels::kArmBlocked);
      if (lowest < KnownLevels::kArmBlocked) {
        ASSERT_GE(levels.least[lowest], needed) << limit;
      }
      ASSERT_LT(levels.least[lowest - 1], needed) << limit;
    }
  }
}

/// A count with a margin to spare is remembered with half of it to spare, or nothing would ever be gained; and a single
/// collision more than the base is, for as long as none is lost.
TEST(KnownLevels, RememberWhatWasCounted) {
  for (const int limit : {1, 5, 39, 280, 2128}) {
    const KnownLevels levels = KnownLevels::of(limit);
    const int counted = kernels::marginCollisions(limit);
    EXPECT_GE(levels.levelOf(counted), levels.lowestWith(counted / 2)) << limit;
    EXPECT_EQ(levels.levelOf(1), levels.lowestWith(1)) << limit;
    EXPECT_EQ(levels.levelOf(0), 0u);
    EXPECT_EQ(levels.levelOf(-1000), 0u);
  }
}

TEST(KnownLevels, CountFromWhatDecides) {
  EXPECT_EQ(kernels::baseCollisions(true, 7, 280), 7);
  EXPECT_EQ(kernels::baseCollisions(false, kNoScore, 280), 279);
}

TEST(KnownWords, HoldEightLevels) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 20000; ++trial) {
    std::array<std::uint32_t, 8> levels;
    std::uint32_t word = static_cast<std::uint32_t>(random());
    for (int n = 0; n < 8; ++n) {
      auto& level = levels.at(static_cast<std::size_t>(n));
      level = static_cast<std::uint32_t>(random() % 16);
      word = kernels::withLevel(word, n, level);
    }
    for (int n = 0; n < 8; ++n) ASSERT_EQ(kernels::levelIn(word, n), levels.at(static_cast<std::size_t>(n)));
    for (std::uint32_t level = 1; level < 16; ++level) {
      std::uint32_t expected = 0;
      for (std::size_t n = 0; n < 8; ++n) expected |= levels.at(n) >= level ? 1u << n : 0u;
      ASSERT_EQ(kernels::atLeastLevel(word, level), expected) << std::hex << word << " level " << level;
    }
  }
}

}  // namespace
}  // namespace accessvdb
