// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of directions against std::bitset.
#include "hostdev/direction_mask.h"

#include <gtest/gtest.h>

#include <bitset>
#include <random>
#include <vector>

namespace accessvdb {
namespace {

using kernels::DirectionMask;

constexpr int kMost = 64 * kernels::kMaxDirectionWords;
using Bits = std::bitset<kMost>;

DirectionMask maskOf(const Bits& bits) {
  DirectionMask mask = {};
  for (int d = 0; d < kMost; ++d) {
    if (bits[static_cast<std::size_t>(d)]) mask.set(d);
  }
  return mask;
}
Bits bitsOf(const DirectionMask& mask) {
  Bits bits;
  for (int d = 0; d < kMost; ++d) bits[static_cast<std::size_t>(d)] = mask.test(d);
  return bits;
}

TEST(DirectionMask, AgreesWithBitset) {
  std::mt19937_64 random(11);
  for (int round = 0; round < 500; ++round) {
    // Few bits in some rounds, so that single words are empty.
    const double share = round % 3 == 0 ? 0.005 : 0.5;
    Bits a, b;
    for (std::size_t d = 0; d < kMost; ++d) {
      a[d] = std::bernoulli_distribution(share)(random);
      b[d] = std::bernoulli_distribution(share)(random);
    }
    const DirectionMask x = maskOf(a), y = maskOf(b);
    EXPECT_EQ(bitsOf(x), a);
    EXPECT_EQ(bitsOf(x | y), a | b);
    EXPECT_EQ(bitsOf(x & y), a & b);
    EXPECT_EQ(bitsOf(without(x, y)), a & ~b);
    EXPECT_EQ(any(x), a.any());
    EXPECT_EQ(any(x & y), (a & b).any());
    EXPECT_EQ(x == y, a == b);
    EXPECT_TRUE(x == maskOf(a));
    std::vector<int> visited, wanted;
    forEachDirection(x, [&](int d) { visited.push_back(d); });
    for (int d = 0; d < kMost; ++d) {
      if (a[static_cast<std::size_t>(d)]) wanted.push_back(d);
    }
    EXPECT_EQ(visited, wanted);
  }
}

/// Every word counts, the last one too.
TEST(DirectionMask, OneDirectionMakesADifference) {
  for (int d = 0; d < kMost; ++d) {
    DirectionMask mask = {};
    EXPECT_FALSE(any(mask));
    mask.set(d);
    EXPECT_TRUE(any(mask)) << d;
    EXPECT_FALSE(mask == DirectionMask{}) << d;
    mask.reset(d);
    EXPECT_TRUE(mask == DirectionMask{}) << d;
  }
}

TEST(DirectionMask, AllDirectionsAreThoseBelowD) {
  for (const int count : {1, 36, 64, 65, 180, 255, 256}) {
    const DirectionMask all = kernels::allDirections(count);
    for (int d = 0; d < kMost; ++d) EXPECT_EQ(all.test(d), d < count) << count << " " << d;
  }
}

}  // namespace
}  // namespace accessvdb
