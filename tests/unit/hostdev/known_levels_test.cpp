// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Levels must never claim more than was counted; how close they come only affects speed. Words are checked direction
/// by direction.
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
    const KnownLevels levels = KnownLevels::forLimit(limit);
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

/// A count at the limit is remembered with most of its margin, whatever was freed before, or nothing would ever be
/// gained; if few collisions count, a single one above the base is remembered as long as none is lost.
TEST(KnownLevels, RememberWhatWasCounted) {
  for (const int limit : kLimits) {
    const KnownLevels levels = KnownLevels::forLimit(limit);
    for (const int freed : {0, mostFreed(levels) / 2, mostFreed(levels)}) {
      EXPECT_GE(4 * levels.collisionsOf(levels.levelOf(limit, freed), freed), 3 * limit) << limit;
      EXPECT_EQ(levels.levelOf(0, freed), 0u);
      EXPECT_EQ(levels.levelOf(-1000, freed), 0u);
    }
    if (limit < 8) {
      EXPECT_EQ(levels.collisionsOf(levels.levelOf(1, 0), 0), 1) << limit;
    }
  }
}

TEST(KnownLevels, CountFromWhatDecides) {
  EXPECT_EQ(kernels::baseCollisions(true, 7, 280), 7);
  EXPECT_EQ(kernels::baseCollisions(false, kNoScore, 280), 279);
}

/// A word, and the same as separate directions.
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

/// With another base, they claim no more than before.
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
    const KnownLevels levels = KnownLevels::forLimit(limit);
    for (int trial = 0; trial < 2000; ++trial) {
      FreedWord freed;
      std::array<int, 8> each;
      for (std::size_t n = 0; n < 8; ++n) {
        const int unit = FreedWord::unitLog2(levels.log2);
        const std::uint64_t units = random() % static_cast<std::uint64_t>((mostFreed(levels) >> unit) + 1);
        freed.bytes |= units << (8 * n);
        each.at(n) = static_cast<int>(units) << unit;
      }
      const std::uint64_t lowest = freed.lowestWithMore(levels.log2);
      for (std::size_t n = 0; n < 8; ++n) {
        ASSERT_EQ(freed.count(static_cast<int>(n), levels.log2), each.at(n));
        const auto of_this = static_cast<std::uint32_t>(lowest >> (8 * n) & 0xff);
        ASSERT_GT(levels.collisionsOf(of_this, each.at(n)), 0);
        ASSERT_LE(levels.collisionsOf(of_this - 1, each.at(n)), 0);
      }
    }
  }
}

/// Voxels are counted one by one, or up to an eighth of a step too many.
TEST(FreedWords, CountInEighthsOfAStep) {
  std::mt19937_64 random(8);
  for (int log2 = 0; log2 <= 10; ++log2) {
    const int most = static_cast<int>(KnownLevels::kMostFreedSteps << log2) - 1, off = log2 > 3 ? (1 << log2) / 8 : 1;
    for (int trial = 0; trial < 1000; ++trial) {
      FreedWord freed;
      std::array<std::uint32_t, 8> more;
      for (std::uint32_t& each : more) {
        each = static_cast<std::uint32_t>(random() % static_cast<std::uint64_t>(most + 2 - off));
      }
      std::uint64_t steps = 1;
      ASSERT_FALSE(freed.add(more.data(), false, log2, steps));
      ASSERT_EQ(steps, 0u);
      for (std::size_t n = 0; n < 8; ++n) {
        const int count = freed.count(static_cast<int>(n), log2), exactly = static_cast<int>(more.at(n));
        ASSERT_GE(count, exactly);
        ASSERT_LT(count, exactly + off);
      }
    }
  }
}

/// Eight directions of a point through many frames: the known value never exceeds the true one, and if nothing is lost
/// it stays.
TEST(FreedWords, AgeWithoutEverClaimingTooMuch) {
  constexpr int kMostCollisions = 65534;
  std::mt19937_64 random(7);
  std::size_t known = 0, lowered = 0, forgotten = 0;
  for (int log2 = 0; log2 <= 10; ++log2) {
    const KnownLevels levels{log2};
    const auto upTo = [&](int most) { return static_cast<int>(random() % static_cast<std::uint64_t>(most + 1)); };
    FreedWord freed;
    std::uint64_t word = 0;
    int base = upTo(1000);
    std::array<int, 8> collisions;
    for (int& each : collisions) each = upTo(kMostCollisions);
    for (int frame = 0; frame < 4000; ++frame) {
      std::array<std::uint32_t, 8> more = {};
      for (std::size_t n = 0; n < 8; ++n) {
        const int kind = upTo(99), most = kind < 50 ? 0 : kind < 95 ? 5 << log2 : kind < 99 ? 60 << log2 : 300 << log2;
        more.at(n) = static_cast<std::uint32_t>(upTo(most));
        // Half of the time, everything that may be lost is lost, and not replaced.
        const bool all = upTo(1) == 0;
        const int lost = all ? static_cast<int>(more.at(n)) : upTo(static_cast<int>(more.at(n)));
        const int gained = all ? 0 : upTo(20 << log2);
        collisions.at(n) = std::clamp(collisions.at(n) - lost + gained, 0, kMostCollisions);
      }
      const bool forget = upTo(999) == 0;
      std::uint64_t steps = 0;
      if (freed.add(more.data(), forget, log2, steps)) {
        ++lowered;
        word = known_word::lowered(word, steps);
      } else {
        ASSERT_EQ(steps, 0u);
      }
      if (forget) {
        ++forgotten;
        ASSERT_EQ(word & known_word::kLevels, 0u);
      }
      if (upTo(9) == 0) {
        const int after = std::max(base + upTo(200) - 100, 0);
        word = known_word::rebased(word, after - base, log2);
        base = after;
      }
      if (const int n = upTo(20); n < 8) {  // counted again
        const auto place = static_cast<std::size_t>(n);
        word = known_word::withLevel(word, n, levels.levelOf(collisions.at(place) - base, freed.count(n, log2)));
      }
      const std::uint64_t lowest = freed.lowestWithMore(log2);
      const std::uint32_t worse = known_word::worse(word, lowest);
      for (std::size_t n = 0; n < 8; ++n) {
        const int place = static_cast<int>(n);
        ASSERT_LT(freed.count(place, log2) >> log2, static_cast<int>(KnownLevels::kMostFreedSteps));
        const std::uint32_t level = known_word::levelIn(word, place);
        if (level == 0) continue;
        ++known;
        ASSERT_LE(base + levels.collisionsOf(level, freed.count(place, log2)), collisions.at(n)) << "log2 " << log2;
        if ((worse >> n & 1u) != 0) {
          ASSERT_GT(collisions.at(n), base);
        }
      }
    }
  }
  EXPECT_GT(known, 10000u);
  EXPECT_GT(lowered, 1000u);
  EXPECT_GT(forgotten, 10u);
}

}  // namespace
}  // namespace accessvdb
