// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Levels must never say more than was counted; how close they come costs time only. Words are checked against the same
/// direction by direction.
#include "hostdev/known_levels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

namespace accessvdb {
namespace {

using kernels::FreedWord;
using kernels::KnownLevels;
namespace known_word = kernels::known_word;

constexpr std::array<int, 9> kLimits = {1, 2, 5, 15, 16, 39, 280, 2128, 65535};

int mostFreed(const KnownLevels& levels) { return static_cast<int>(KnownLevels::kMostFreedSteps << levels.log2) - 1; }

TEST(KnownLevels, NeverSayMoreThanWasCounted) {
  std::mt19937 random(3);
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    std::uniform_int_distribution<int> freed_of(0, mostFreed(levels));
    for (int more = 1; more < 70000; ++more) {
      const int freed = freed_of(random);
      const std::uint32_t level = levels.levelOf(more, freed);
      ASSERT_LE(level, KnownLevels::kMost);
      if (level > 0) {
        ASSERT_LE(levels.collisionsOf(level, freed), more) << limit;
      }
      if (level < KnownLevels::kMost) {
        ASSERT_GT(levels.collisionsOf(level + 1, freed), more) << limit;
      }
    }
  }
}

TEST(KnownLevels, TheLowestLevelWithMoreIsTheLowest) {
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    for (int freed = 0; freed <= mostFreed(levels); ++freed) {
      const std::uint32_t lowest = levels.lowestWithMore(freed);
      ASSERT_GT(levels.collisionsOf(lowest, freed), 0) << limit;
      if (lowest > 1) {
        ASSERT_LE(levels.collisionsOf(lowest - 1, freed), 0) << limit;
      }
    }
  }
}

/// A count at the limit is remembered with most of it to spare, whatever was freed before, or nothing would ever be
/// gained; where few collisions count, a single one more than the base is, for as long as none is lost.
TEST(KnownLevels, RememberWhatWasCounted) {
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    for (const int freed : {0, mostFreed(levels) / 2, mostFreed(levels)}) {
      EXPECT_GE(4 * levels.collisionsOf(levels.levelOf(limit, freed), freed), 3 * limit) << limit;
      EXPECT_EQ(levels.levelOf(0, freed), 0u);
      EXPECT_EQ(levels.levelOf(-1000, freed), 0u);
    }
    EXPECT_LT(mostFreed(levels), 1 << 16) << limit;
    if (limit < 8) {
      EXPECT_EQ(levels.levelOf(1, 0), levels.lowestWithMore(0)) << limit;
    }
  }
}

TEST(KnownLevels, CountFromWhatDecides) {
  EXPECT_EQ(kernels::baseCollisions(true, 7, 280), 7);
  EXPECT_EQ(kernels::baseCollisions(false, kNoScore, 280), 279);
}

/// A word, and the same direction by direction.
struct Eight {
  std::uint64_t word = 0;
  std::array<std::uint32_t, 8> level = {};
  std::array<bool, 8> arm = {};

  explicit Eight(std::mt19937_64& random) {
    for (std::size_t n = 0; n < 8; ++n) {
      level.at(n) = random() % 3 == 0 ? 0 : static_cast<std::uint32_t>(random() % 128);
      arm.at(n) = random() % 4 == 0;
      word = known_word::withLevel(word, static_cast<int>(n), level.at(n));
      if (arm.at(n)) word |= known_word::spread(1u << n);
    }
  }
};

TEST(KnownWords, HoldEightDirections) {
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 20000; ++trial) {
    const Eight eight(random);
    std::uint32_t arms = 0;
    for (std::size_t n = 0; n < 8; ++n) {
      ASSERT_EQ(known_word::levelIn(eight.word, static_cast<int>(n)), eight.level.at(n));
      arms |= eight.arm.at(n) ? 1u << n : 0u;
    }
    ASSERT_EQ(known_word::gather(eight.word & known_word::kArms), arms);
    ASSERT_EQ(known_word::spread(arms), eight.word & known_word::kArms);
  }
}

TEST(KnownWords, KnowWhichDirectionsAreWorse) {
  std::mt19937_64 random(2);
  for (int trial = 0; trial < 20000; ++trial) {
    const Eight eight(random);
    std::uint64_t lowest = 0;
    std::uint32_t expected = 0;
    for (std::size_t n = 0; n < 8; ++n) {
      const std::uint64_t of_this = random() % 128 + 1;
      lowest |= of_this << (8 * n);
      if (eight.arm.at(n) || eight.level.at(n) >= of_this) expected |= 1u << n;
    }
    ASSERT_EQ(known_word::worse(eight.word, lowest), expected) << std::hex << eight.word << " " << lowest;
  }
}

TEST(KnownWords, AreLoweredAndRaised) {
  std::mt19937_64 random(4);
  for (int trial = 0; trial < 20000; ++trial) {
    const Eight eight(random);
    std::uint64_t steps = 0;
    const auto more = static_cast<std::uint32_t>(random() % 128);
    std::uint64_t lower = eight.word & known_word::kArms, higher = lower;
    for (std::size_t n = 0; n < 8; ++n) {
      const std::uint32_t less = static_cast<std::uint32_t>(random() % 128), level = eight.level.at(n);
      steps |= std::uint64_t{less} << (8 * n);
      lower = known_word::withLevel(lower, static_cast<int>(n), level > less ? level - less : 0);
      higher = known_word::withLevel(higher, static_cast<int>(n), level == 0 ? 0 : std::min(level + more, 127u));
    }
    ASSERT_EQ(known_word::lowered(eight.word, steps), lower) << std::hex << eight.word << " " << steps;
    ASSERT_EQ(known_word::raised(eight.word, more), higher) << std::hex << eight.word << " " << more;
  }
}

/// From another base they say no more than before.
TEST(KnownWords, AreCountedFromAnotherBase) {
  std::mt19937_64 random(5);
  for (int trial = 0; trial < 20000; ++trial) {
    const Eight eight(random);
    const int log2 = static_cast<int>(random() % 6), more = static_cast<int>(random() % 6001) - 3000;
    const std::uint64_t word = known_word::rebased(eight.word, more, log2);
    ASSERT_EQ(word & known_word::kArms, eight.word & known_word::kArms);
    for (int n = 0; n < 8; ++n) {
      const auto before = static_cast<int>(known_word::levelIn(eight.word, n) << log2),
                 after = static_cast<int>(known_word::levelIn(word, n) << log2);
      if (after == 0) continue;
      ASSERT_GT(before, 0);
      ASSERT_LE(after, before - more);
      if (after < 127 << log2) {
        ASSERT_GT(after, before - more - (1 << log2));
      }
    }
  }
}

TEST(FreedWords, GiveTheLowestLevels) {
  std::mt19937_64 random(6);
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::of(limit);
    for (int trial = 0; trial < 2000; ++trial) {
      FreedWord freed;
      std::array<int, 8> each;
      for (std::size_t n = 0; n < 8; ++n) {
        each.at(n) = static_cast<int>(random() % static_cast<std::uint64_t>(mostFreed(levels) + 1));
        freed.pairs[n / 2] |= static_cast<std::uint32_t>(each.at(n)) << (16 * (n % 2));
      }
      const std::uint64_t lowest = freed.lowestWithMore(levels.log2);
      for (std::size_t n = 0; n < 8; ++n) {
        ASSERT_EQ(freed.of(static_cast<int>(n)), each.at(n));
        ASSERT_EQ(lowest >> (8 * n) & 0xff, levels.lowestWithMore(each.at(n)));
      }
    }
  }
}

}  // namespace
}  // namespace accessvdb
