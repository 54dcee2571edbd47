// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <utility>

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
    std::vector<Index3> voxels;
    for (const auto& [v, id] : expected) {
      voxels.push_back(v);
      voxels.push_back(voxel());
    }
    std::vector<Located> located(voxels.size());
    index.locate(voxels, located);
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      ASSERT_EQ(located[n].id, index.find(voxels[n]));
      ASSERT_EQ(located[n].block, index.blockAt(parentOf(voxels[n])));
    }
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

/// Batches of all sizes, into existing and missing blocks.
TEST(SurfaceIndex, InsertingAllAtOnceEqualsOneByOne) {
  for (const std::int32_t extent : {3, 20, 300, 1000000}) {
    Random random(static_cast<std::uint64_t>(extent) + 7);
    SurfaceIndex one_by_one, at_once;
    std::set<Index3> taken;
    std::uint32_t next_id = 0;
    for (const std::size_t batch : {std::size_t{0}, std::size_t{1}, std::size_t{2}, std::size_t{300}, std::size_t{5000},
                                    std::size_t{40}, std::size_t{2000}, std::size_t{0}}) {
      std::vector<NewVoxel> points;
      for (std::size_t n = 0; n < batch; ++n) {
        const Index3 v = {random.between(-extent, extent), random.between(-extent, extent),
                          random.between(-extent, extent)};
        if (taken.insert(v).second) points.push_back({v, next_id++, kNone});
      }
      std::ranges::sort(points, {}, [](const NewVoxel& point) { return placeOf(point.voxel); });
      // Blocks known beforehand, for every other batch.
      for (NewVoxel& point : points) {
        Located place;
        at_once.locate({&point.voxel, 1}, {&place, 1});
        ASSERT_EQ(place.id, kNone);
        if (batch % 3 == 0) point.block = place.block;
      }
      at_once.insertAll(points);
      for (const NewVoxel& point : points) {
        const std::uint32_t block = one_by_one.insert(point.voxel, point.id);
        ASSERT_EQ(one_by_one.blockAt(parentOf(point.voxel)), block);
        ASSERT_EQ(at_once.blockAt(parentOf(point.voxel)), block);
        ASSERT_EQ(point.block, block);
        const Index3 leaf_group = parentOf(parentOf(point.voxel));
        ASSERT_EQ(at_once.leafGroupAt(leaf_group), one_by_one.leafGroupAt(leaf_group));
      }
      std::set<std::uint32_t> changed;
      for (const NewVoxel& point : points) changed.insert(point.block);
      std::vector<std::uint32_t> last;
      at_once.blocksOfLastInsert(last);
      ASSERT_EQ(std::set<std::uint32_t>(last.begin(), last.end()), changed);
      ASSERT_EQ(last.size(), changed.size());
      ASSERT_EQ(at_once.leafGroups(), one_by_one.leafGroups());
      ASSERT_EQ(at_once.blocks().size(), one_by_one.blocks().size());
      for (std::size_t b = 0; b < at_once.blocks().size(); ++b) {
        const PointBlock& a = at_once.blocks()[b];
        ASSERT_EQ(at_once.blockAt(a.leaf), b);
        const std::uint32_t other = one_by_one.blockAt(a.leaf);
        ASSERT_NE(other, kNone);
        const PointBlock& o = one_by_one.blocks()[other];
        ASSERT_EQ(a.occupied, o.occupied);
        ASSERT_TRUE(std::ranges::equal(a.ids, o.ids));
        ASSERT_EQ(a.leaf_group, at_once.leafGroupAt(parentOf(a.leaf)));
        ASSERT_EQ(at_once.blockIn(a.leaf_group, bitInParent(a.leaf)), b);
      }
    }
    ASSERT_EQ(at_once.leafGroupAt({1 << 19, 0, 0}), kNone);
    if (extent == 20) {
      ASSERT_GT(next_id, 4 * at_once.blocks().size());  // blocks of many points
    }
  }
}

TEST(SurfaceIndex, PlacesSortByLeafAndThenByBit) {
  constexpr std::int32_t kEdge = 1 << 20;
  std::vector<Index3> voxels = {{-kEdge, -kEdge, -kEdge}, {kEdge - 1, kEdge - 1, kEdge - 1}, {0, 0, 0}, {-1, 0, 7}};
  Random random(11);
  for (const std::int32_t extent : {9, 40, kEdge - 1}) {
    for (int n = 0; n < 200; ++n) {
      voxels.push_back(
          {random.between(-extent, extent), random.between(-extent, extent), random.between(-extent, extent)});
    }
  }
  for (const Index3& a : voxels) {
    ASSERT_EQ(voxelAt(placeOf(a)), a);
    for (const Index3& b : voxels) {
      ASSERT_EQ(placeOf(a) < placeOf(b),
                std::make_pair(parentOf(a), bitInParent(a)) < std::make_pair(parentOf(b), bitInParent(b)));
    }
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
    index.forEachBlock(low, high,
                       [&](std::uint32_t block, const Index3& leaf) { ASSERT_EQ(leaf, index.blocks()[block].leaf); });
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
