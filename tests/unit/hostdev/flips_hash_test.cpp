// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Any difference between what a scan flipped on two machines must show in its hash, and no order may.
#include "hostdev/flips_hash.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
#include <set>
#include <vector>

#include "launch/leaf_patch.h"

namespace accessvdb {
namespace {

using kernels::flipsHash;

LeafChange randomChange(std::mt19937_64& random) {
  LeafChange change;
  for (std::int32_t& least : change.origin_ijk) least = 8 * (static_cast<std::int32_t>(random() % 4001) - 2000);
  for (LeafBits* bits : {&change.arm_free_on, &change.collides_on, &change.arm_free_off, &change.collides_off}) {
    for (std::uint64_t& word : *bits) word = random() % 3 == 0 ? 0 : random() & random();
  }
  return change;
}

/// Worked out with whole numbers of any size in Python.
TEST(FlipsHash, EqualsAnotherImplementation) {
  LeafChange change;
  change.origin_ijk = {-16, 8, 24};
  for (std::size_t w = 0; w < 8; w += 2) {
    change.arm_free_on[w] = 0x0101010101010101u * (w + 1);
    change.collides_on[w + 1] = std::uint64_t{1} << (9 * w);
    change.arm_free_off[7 - w] = ~std::uint64_t{0} - w;
    change.collides_off[w] = 3 * w;
  }
  EXPECT_EQ(flipsHash(change), 0x1cfd47d4b12f29a7u);
}

TEST(FlipsHash, SumsTheWordsInTheOrderOfPatches) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 100; ++n) {
    const LeafChange change = randomChange(random);
    const auto [x, y, z] = change.origin_ijk;
    std::uint64_t sum = 0;
    const auto sets = kernels::bitsInOrder(change);
    for (std::uint32_t number = kernels::kFlipWords; number-- > 0;) {
      sum += kernels::flipsHashOfWord((*sets[number / 8])[number % 8], number, kernels::flipsKey(x, y, z));
    }
    ASSERT_EQ(flipsHash(change), sum);
  }
  EXPECT_EQ(flipsHash(LeafChange{}), 0u);
}

TEST(FlipsHash, SeesEveryBitOfEveryWord) {
  std::mt19937_64 random(2);
  for (int n = 0; n < 20; ++n) {
    LeafChange change = n == 0 ? LeafChange{} : randomChange(random);
    std::set<std::uint64_t> hashes = {flipsHash(change)};
    for (LeafBits* bits : {&change.arm_free_on, &change.collides_on, &change.arm_free_off, &change.collides_off}) {
      for (std::uint64_t& word : *bits) {
        for (int bit = 0; bit < 64; ++bit) {
          word ^= std::uint64_t{1} << bit;
          hashes.insert(flipsHash(change));
          word ^= std::uint64_t{1} << bit;
        }
      }
    }
    ASSERT_EQ(hashes.size(), 1u + 4 * 512) << "leaf " << n;
  }
}

/// Leaves around many places, also across the axes, with the same flips: even those of one voxel.
TEST(FlipsHash, SeesWhereTheLeafIs) {
  std::mt19937_64 random(3);
  for (int n = 0; n < 40; ++n) {
    LeafChange change = randomChange(random);
    if (n % 4 == 1) {
      change = {};
      change.collides_off[7] = std::uint64_t{1} << 63;
    }
    if (n % 4 == 2) change.origin_ijk = {0, 0, 0};
    if (n % 4 == 3) change.origin_ijk = {-(1 << 23), (1 << 23) - 8, -(1 << 23)};
    const auto centre = change.origin_ijk;
    std::set<std::uint64_t> hashes;
    for (std::int32_t near = 0; near < 125; ++near) {
      change.origin_ijk = {centre[0] + 8 * (near / 25 - 2), centre[1] + 8 * (near / 5 % 5 - 2),
                           centre[2] + 8 * (near % 5 - 2)};
      hashes.insert(flipsHash(change));
    }
    ASSERT_EQ(hashes.size(), 125u) << "leaf " << n;
  }
}

TEST(FlipsHash, SeesWhichFactFlippedAndHow) {
  std::mt19937_64 random(4);
  const LeafChange change = randomChange(random);
  std::array<LeafBits, 4> sets = {change.arm_free_on, change.collides_on, change.arm_free_off, change.collides_off};
  std::sort(sets.begin(), sets.end());
  std::set<std::uint64_t> hashes;
  do {
    hashes.insert(flipsHash(LeafChange{change.origin_ijk, sets[0], sets[1], sets[2], sets[3]}));
  } while (std::next_permutation(sets.begin(), sets.end()));
  EXPECT_EQ(hashes.size(), 24u);
}

/// One flip that is exchanged between leaves, or in the wrong one, shows in the sum of all.
TEST(FlipsHash, SeesFlipsInTheWrongLeaf) {
  std::mt19937_64 random(5);
  LeafChange a = randomChange(random), b = randomChange(random);
  const std::uint64_t before = flipsHash(a) + flipsHash(b);
  for (std::size_t w = 0; w < 8; ++w) {
    if (a.collides_on[w] == b.collides_on[w]) continue;
    std::swap(a.collides_on[w], b.collides_on[w]);
    EXPECT_NE(flipsHash(a) + flipsHash(b), before) << "word " << w;
    std::swap(a.collides_on[w], b.collides_on[w]);
  }
  std::swap(a.origin_ijk, b.origin_ijk);
  EXPECT_NE(flipsHash(a) + flipsHash(b), before);
}

}  // namespace
}  // namespace accessvdb
