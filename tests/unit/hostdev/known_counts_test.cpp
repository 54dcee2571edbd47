// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bounds that follow flips, two to a word, against plain integers.
#include "hostdev/known_counts.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <random>
#include <set>

namespace accessvdb::kernels {
namespace {

using known_count::kArmBlocked;
using known_count::kMost;
using known_count::kMostTogether;
using known_count::kUnknown;

std::uint16_t plainlyChanged(std::uint16_t count, int more) {
  const std::uint16_t arm = count & kArmBlocked, bound = count & 0x7fff;
  if (bound == kUnknown) return count;
  const int now = bound + more;
  return static_cast<std::uint16_t>(arm | (now < 0 ? kUnknown : now > kMost ? kMost : now));
}

std::uint32_t pairOf(int low, int high) {
  return (static_cast<std::uint32_t>(low) & 0xffffu) | static_cast<std::uint32_t>(high) << 16;
}

TEST(KnownCount, TwoToAWordChangeAsEachOnItsOwn) {
  std::mt19937 random(1);
  const std::array<int, 10> bounds = {0, 1, 126, 127, 128, 5000, kMost - 127, kMost - 1, kMost, kUnknown};
  const auto any = [&] {
    const int bound =
        random() % 4 == 0 ? static_cast<int>(random() % (kMost + 1)) : bounds.at(random() % bounds.size());
    return static_cast<std::uint16_t>(bound | (random() % 2 == 0 ? kArmBlocked : 0));
  };
  const auto step = [&] {
    const std::array<int, 5> ends = {-kMostTogether, -1, 0, 1, kMostTogether};
    return random() % 2 == 0 ? ends.at(random() % ends.size())
                             : static_cast<int>(random() % (2 * kMostTogether + 1)) - kMostTogether;
  };
  int unknown = 0, most = 0;
  for (int n = 0; n < 1'000'000; ++n) {
    const std::uint16_t low = any(), high = any();
    const int more_low = step(), more_high = step();
    const std::uint32_t wanted = pairOf(plainlyChanged(low, more_low), plainlyChanged(high, more_high));
    ASSERT_EQ(known_count::changedBy(pairOf(low, high), pairOf(more_low, more_high)), wanted)
        << low << " by " << more_low << ", " << high << " by " << more_high;
    unknown += (wanted & kUnknown) == kUnknown ? 1 : 0;
    most += (wanted & kUnknown) == kMost ? 1 : 0;
  }
  EXPECT_GT(unknown, 10'000);
  EXPECT_GT(most, 10'000);
}

/// In whatever order and parts voxels are taken, a bound stays one, and a count that is known at the end is right.
TEST(KnownCount, NeverExceedsTheCountInAnyOrder) {
  std::mt19937 random(2);
  int known = 0;
  for (int round = 0; round < 20'000; ++round) {
    const int before = static_cast<int>(random() % 40);
    std::uint32_t count = static_cast<std::uint32_t>(before);
    int now = before;
    std::array<int, 4> parts = {};
    for (int& part : parts) now += part = static_cast<int>(random() % 61) - 30;
    if (now < 0) continue;  // more cannot stop colliding than did
    for (const int part : parts) count = known_count::changedBy(count, pairOf(part, 0));
    const std::uint16_t bound = known_count::boundOf(static_cast<std::uint16_t>(count));
    if (bound == kUnknown) continue;
    ASSERT_EQ(bound, now);
    ++known;
  }
  EXPECT_GT(known, 1000);
}

TEST(KnownCount, LearnsTheLargerBoundAndIsLoweredToNoLessThanNothing) {
  EXPECT_EQ(known_count::learnt(kUnknown, 7), 7);
  EXPECT_EQ(known_count::learnt(9, 7), 9);
  EXPECT_EQ(known_count::learnt(5 | kArmBlocked, 7), 7 | kArmBlocked);
  EXPECT_EQ(known_count::learnt(5, 65535), kMost);
  EXPECT_EQ(known_count::loweredBy(9 | kArmBlocked, 4), 5 | kArmBlocked);
  EXPECT_EQ(known_count::loweredBy(9, 65535), 0);
  EXPECT_EQ(known_count::loweredBy(kUnknown, 4), kUnknown);
}

/// Each lane's steps are in one bank of shared memory, and no two directions share a byte.
TEST(StepPlace, IsInTheBankOfTheLane) {
  std::set<int> places;
  for (int d = 0; d < 256; ++d) {
    const int place = stepPlace(d);
    EXPECT_EQ(place / 4 % 32, 0) << d;
    EXPECT_TRUE(places.insert(place).second) << d;
  }
  EXPECT_LT(*places.rbegin(), 64 * 128);
}

}  // namespace
}  // namespace accessvdb::kernels
