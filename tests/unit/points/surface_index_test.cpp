// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::Random;

TEST(SurfaceIndex, EqualsAMap) {
  for (const std::int32_t extent : {6, 40, 300, 1000000}) {
    Random random(static_cast<std::uint64_t>(extent));
    SurfaceIndex index;
    std::map<Index3, std::uint32_t> expected;
    const auto voxel = [&] {
      return Index3{random.between(-extent, extent), random.between(-extent, extent), random.between(-extent, extent)};
    };
    EXPECT_EQ(index.find({0, 0, 0}), kNone);
    for (std::uint32_t id = 0; id < 8000; ++id) {
      const Index3 v = voxel();
      if (expected.try_emplace(v, id).second) index.insert(v, id);
    }
    for (const auto& [v, id] : expected) ASSERT_EQ(index.find(v), id);
    for (int n = 0; n < 8000; ++n) {
      const Index3 v = voxel();
      const auto found = expected.find(v);
      ASSERT_EQ(index.find(v), found == expected.end() ? kNone : found->second);
    }
    // Blocks hold every id once, in the order of voxels, under the right leaf.
    std::set<std::uint32_t> ids;
    for (std::uint32_t b = 0; b < index.blocks().size(); ++b) {
      const PointBlock& block = index.blocks()[b];
      ASSERT_EQ(index.blockAt(block.leaf), b);
      std::size_t n = 0;
      for (std::int32_t bit = 0; bit < 512; ++bit) {
        if ((block.occupied[static_cast<std::size_t>(bit >> 6)] >> (bit & 63) & 1) == 0) continue;
        const Index3 v = {block.leaf[0] * 8 + (bit >> 6), block.leaf[1] * 8 + (bit >> 3 & 7),
                          block.leaf[2] * 8 + (bit & 7)};
        ASSERT_LT(n, block.ids.size());
        ASSERT_EQ(expected.at(v), block.ids[n]);
        ids.insert(block.ids[n++]);
      }
      ASSERT_EQ(n, block.ids.size());
    }
    ASSERT_EQ(ids.size(), expected.size());
  }
}

TEST(SurfaceIndex, VisitsTheBlocksOfABoxOnceEach) {
  Random random(4);
  SurfaceIndex index;
  std::set<Index3> leaves;
  for (std::uint32_t id = 0; id < 3000; ++id) {
    const Index3 v = {random.between(-200, 200), random.between(-200, 200), random.between(-200, 200)};
    if (index.find(v) != kNone) continue;
    index.insert(v, id);
    leaves.insert(parentOf(v));
  }
  std::size_t visited_blocks = 0;
  for (int n = 0; n < 400; ++n) {
    const Index3 low = {random.between(-30, 25), random.between(-30, 25), random.between(-30, 25)};
    const Index3 high = {low[0] + random.below(20), low[1] + random.below(20), low[2] + random.below(20)};
    std::multiset<Index3> visited;
    index.forEachBlock(low, high, [&](std::uint32_t block) { visited.insert(index.blocks()[block].leaf); });
    std::multiset<Index3> expected;
    for (const Index3& leaf : leaves) {
      bool inside = true;
      for (std::size_t a = 0; a < 3; ++a) inside = inside && leaf[a] >= low[a] && leaf[a] <= high[a];
      if (inside) expected.insert(leaf);
    }
    ASSERT_EQ(visited, expected);
    visited_blocks += visited.size();
  }
  EXPECT_GT(visited_blocks, 1000u);
}

}  // namespace
}  // namespace accessvdb::internal
