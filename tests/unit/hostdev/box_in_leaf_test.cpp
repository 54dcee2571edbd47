// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels of a leaf that are in a box, against asking each of them.
#include "hostdev/box_in_leaf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>

namespace accessvdb {
namespace {

TEST(BoxInLeaf, HoldsTheVoxelsThatAreInBoth) {
  std::mt19937_64 random(1);
  const auto below = [&](int n) { return static_cast<std::int32_t>(random() % static_cast<unsigned>(n)); };
  int partial = 0;
  for (int n = 0; n < 5000; ++n) {
    std::int32_t leaf[3], low[3], high[3];
    for (int k = 0; k < 3; ++k) {
      leaf[k] = below(7) - 3;
      low[k] = leaf[k] * 8 + below(20) - 12;  // has some of the leaf
      high[k] = std::max(low[k], leaf[k] * 8) + below(12);
    }
    const kernels::BoxInLeaf box(leaf, low, high);
    int inside = 0;
    for (int voxel = 0; voxel < 512; ++voxel) {
      const int at[3] = {voxel >> 6, voxel >> 3 & 7, voxel & 7};
      bool expected = true;
      for (int k = 0; k < 3; ++k) {
        const std::int32_t i = leaf[k] * 8 + at[k];
        expected = expected && i >= low[k] && i <= high[k];
      }
      ASSERT_EQ((box.wordAt(at[0]) >> (voxel & 63) & 1u) != 0, expected);
      std::uint64_t only[8] = {};
      only[at[0]] = std::uint64_t{1} << (voxel & 63);
      ASSERT_EQ(box.hasAnyOf(only), expected);
      ASSERT_TRUE(!expected || at[0] <= box.lastX());
      inside += expected ? 1 : 0;
    }
    ASSERT_GT(inside, 0);
    partial += inside < 512 ? 1 : 0;
  }
  EXPECT_GT(partial, 1000);
}

}  // namespace
}  // namespace accessvdb
