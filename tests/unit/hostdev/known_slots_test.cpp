// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "hostdev/known_slots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <set>
#include <vector>

#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {
namespace {

constexpr int kMostDirections = 256;

TEST(KnownSlots, NeverNeedASlotTwiceForOneArc) {
  int fewer = 0;
  for (int directions = 4; directions <= kMostDirections; ++directions) {
    for (int arc = 1; arc <= directions; ++arc) {
      const KnownSlots slots = KnownSlots::of(directions, arc);
      ASSERT_LE(slots.slots, slots.words);
      if (slots.all()) continue;
      ++fewer;
      for (int first = 0; first < directions; ++first) {
        std::set<int> words, used;
        for (int n = 0; n < arc; ++n) words.insert((first + n) % directions / kKnownPerWord);
        for (const int word : words) used.insert(slots.slotOf(word));
        ASSERT_EQ(used.size(), words.size()) << arc << " of " << directions << " from " << first;
        ASSERT_GE(*used.begin(), 0);
        ASSERT_LT(*used.rbegin(), slots.slots);
      }
    }
  }
  EXPECT_GT(fewer, 5000);
}

TEST(KnownSlots, TakeAboutHalfTheMemoryOfTheDefault) {
  const int arc = mostInCone(180, std::cos(70 * std::numbers::pi / 180));
  EXPECT_EQ(KnownSlots::of(180, arc).slots, 12);
  EXPECT_EQ(KnownSlots::of(180, 0).slots, 23);
  EXPECT_EQ(KnownSlots::of(36, mostInCone(36, std::cos(70 * std::numbers::pi / 180))).slots, 5);
}

TEST(KnownSlots, ListTheWordsThatAreHeld) {
  std::mt19937_64 random(6);
  for (const KnownSlots slots : {KnownSlots::of(180, 72), KnownSlots::of(256, 60), KnownSlots::of(256, 0)}) {
    std::uint32_t note = KnownSlots::kNothingHeld;
    for (int word = 0; word < slots.words; ++word) EXPECT_EQ(slots.holds(note, word), slots.all());
    for (int step = 0; step < 500; ++step) {
      const int taken = static_cast<int>(random() % static_cast<unsigned>(slots.words));
      if (!slots.all()) note ^= slots.changes(note, taken);
      const std::uint32_t held = slots.held(note);
      int found = 0;
      for (int word = 0; word < slots.words; ++word) ASSERT_EQ((held >> word & 1u) != 0, slots.holds(note, word));
      for (int slot = 0; slot < slots.slots; ++slot) {
        const int word = slots.wordIn(note, slot);
        if (word < 0) continue;
        ++found;
        ASSERT_TRUE(slots.holds(note, word));
        ASSERT_EQ(slots.slotOf(word), slot);
      }
      ASSERT_EQ(found, __builtin_popcount(held));
      ASSERT_TRUE((held >> taken & 1u) != 0);
      ASSERT_EQ(std::uint64_t{held} >> slots.words, 0u);
    }
  }
}

/// The note against a list of what each slot holds.
TEST(KnownSlots, NoteWhatEachSlotHolds) {
  std::mt19937_64 random(5);
  for (const KnownSlots slots : {KnownSlots::of(180, 72), KnownSlots::of(256, 60), KnownSlots::of(240, 30)}) {
    ASSERT_FALSE(slots.all());
    std::vector<int> holds;
    for (int s = 0; s < slots.slots; ++s) holds.push_back(s);
    std::uint32_t note = 0;  // of a new point
    for (int step = 0; step < 2000; ++step) {
      for (int word = 0; word < slots.words; ++word) {
        const bool held = holds[static_cast<std::size_t>(slots.slotOf(word))] == word;
        ASSERT_EQ(slots.holds(note, word), held);
        ASSERT_EQ(slots.changes(note, word) == 0, held);
      }
      const int word = std::uniform_int_distribution<int>(0, slots.words - 1)(random);
      note ^= slots.changes(note, word);
      holds[static_cast<std::size_t>(slots.slotOf(word))] = word;
    }
  }
}

TEST(KnownSlots, GiveEachWordItsOwnIfDirectionsMayBeAny) {
  const KnownSlots slots = KnownSlots::of(200, 0);
  EXPECT_TRUE(slots.all());
  for (int word = 0; word < slots.words; ++word) {
    EXPECT_EQ(slots.slotOf(word), word);
    EXPECT_TRUE(slots.holds(0, word));
  }
}

/// As many directions as a walk visits at most.
TEST(MostInCone, IsReachedAndNeverExceeded) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> yaw(0, 2 * std::numbers::pi), height(-0.9, 0.9);
  for (const int directions : {4, 36, 180, 256}) {
    std::vector<float> xy;
    for (int d = 0; d < directions; ++d) {
      const double angle = 2 * std::numbers::pi * d / directions;
      xy.insert(xy.end(), {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle))});
    }
    for (const double cone_deg : {10.0, 45.0, 70.0, 90.0}) {
      ApproachView approach;
      approach.direction_xy = xy.data();
      approach.num_directions = directions;
      approach.normal_cos_min = static_cast<float>(std::cos(cone_deg * std::numbers::pi / 180));
      const int most = mostInCone(directions, approach.normal_cos_min);
      int largest = 0;
      for (int n = 0; n < 400; ++n) {
        const double angle = yaw(random), z = n % 2 == 0 ? 0 : height(random), across = std::sqrt(1 - z * z);
        const float normal[3] = {static_cast<float>(across * std::cos(angle)),
                                 static_cast<float>(across * std::sin(angle)), static_cast<float>(z)};
        DirectionWalk walk(approach, normal);
        int count = 0;
        while (walk.next() >= 0) ++count;
        largest = std::max(largest, count);
      }
      EXPECT_LE(largest, most);
      EXPECT_GE(largest, most - 2);
    }
  }
}

}  // namespace
}  // namespace accessvdb::kernels
