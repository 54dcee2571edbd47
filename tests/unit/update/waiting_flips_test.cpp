// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What waits for a device against a plain list of what happened to each voxel.
#include "update/waiting_flips.h"

#include <gtest/gtest.h>

#include <map>
#include <random>
#include <tuple>

#include "update/flip_set.h"

namespace accessvdb::internal {
namespace {

/// By leaf and voxel, how often it began to collide, less how often it ceased to.
using Began = std::map<std::tuple<int, int, int, int>, int>;

LeafChange randomChange(std::mt19937_64& random) {
  LeafChange change;
  for (std::int32_t& axis : change.origin_ijk) axis = 8 * (static_cast<int>(random() % 3) - 1);
  for (int n = 0; n < 4; ++n) {
    LeafBits& bits = random() % 2 == 0 ? change.collides_on : change.collides_off;
    bits[random() % 2] |= std::uint64_t{1} << (random() % 64);
  }
  change.arm_free_on[random() % 8] |= std::uint64_t{1} << (random() % 64);
  change.arm_free_off[random() % 8] |= std::uint64_t{1} << (random() % 64);
  return change;
}

void note(const LeafChange& change, Began& began) {
  const auto& o = change.origin_ijk;
  for (int voxel = 0; voxel < 512; ++voxel) {
    const auto is = [&](const LeafBits& bits) { return static_cast<int>(bits[voxel / 64] >> (voxel % 64) & 1); };
    const int by = is(change.collides_on) - is(change.collides_off);
    if (by != 0) began[{o[0] / 8, o[1] / 8, o[2] / 8, voxel}] += by;
  }
}

Began toldBy(const WaitingFlips& flips, std::uint32_t first) {
  Began began;
  for (const kernels::LeafFlips& leaf : flips.leaves()) {
    for (std::uint32_t n = 0; n < leaf.voxels; ++n) {
      const std::uint16_t code = flips.voxels().at(leaf.first_voxel - first + n);
      began[{leaf.leaf[0], leaf.leaf[1], leaf.leaf[2], code >> 1}] += (code & 1) != 0 ? 1 : -1;
    }
  }
  return began;
}

Began withoutZeros(Began began) {
  std::erase_if(began, [](const auto& voxel) { return voxel.second == 0; });
  return began;
}

/// A list may hold a voxel that began to collide twice: what happened in between may be in another one.
TEST(WaitingFlips, NameWhatEachVoxelCameToAfterAnyJoin) {
  std::mt19937_64 random(1);
  int twice = 0;
  for (int round = 0; round < 50; ++round) {
    WaitingFlips flips;
    Began wanted;
    std::map<std::tuple<int, int, int>, std::uint32_t> kinds;
    std::uint32_t first = 0;
    for (int step = 0; step < 200; ++step) {
      const LeafChange change = randomChange(random);
      flips.add(change, true);
      note(change, wanted);
      const auto& o = change.origin_ijk;
      kinds[{o[0] / 8, o[1] / 8, o[2] / 8}] |= kindsOf(change);
      if (random() % 20 == 0) flips.join();
      if (random() % 20 == 0) flips.beginVoxelsAt(first = static_cast<std::uint32_t>(random() % 1'000'000));
    }
    ASSERT_EQ(withoutZeros(toldBy(flips, first)), withoutZeros(wanted));
    flips.join();
    ASSERT_EQ(toldBy(flips, first), withoutZeros(wanted)) << "none of those that came back";
    ASSERT_EQ(flips.leaves().size(), kinds.size()) << "each leaf once";
    for (const kernels::LeafFlips& leaf : flips.leaves()) {
      ASSERT_EQ(leaf.kinds, (kinds[{leaf.leaf[0], leaf.leaf[1], leaf.leaf[2]}]));
    }
    for (const auto& [voxel, by] : wanted) twice += by > 1 || by < -1 ? 1 : 0;
    flips.clear();
    flips.add(randomChange(random), true);
    ASSERT_EQ(flips.leaves().front().first_voxel, 0u);
  }
  EXPECT_GT(twice, 1000);
}

TEST(WaitingFlips, NameNoVoxelsUnlessTheyAreAskedFor) {
  std::mt19937_64 random(2);
  WaitingFlips flips;
  for (int n = 0; n < 100; ++n) flips.add(randomChange(random), false);
  flips.join();
  EXPECT_TRUE(flips.voxels().empty());
  for (const kernels::LeafFlips& leaf : flips.leaves()) {
    EXPECT_EQ(leaf.voxels, 0u);
    EXPECT_NE(leaf.freed_columns, 0u);
    EXPECT_NE(leaf.blocked_columns, 0u);
    EXPECT_NE(leaf.freed_heights, 0u);
    EXPECT_NE(leaf.blocked_heights, 0u);
  }
}

}  // namespace
}  // namespace accessvdb::internal
