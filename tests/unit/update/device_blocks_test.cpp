// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Groups of blocks as reported to a device.
#include "update/device_blocks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

TEST(BlockGroups, HaveAnEdgeOfEightCentimetresAtMost) {
  const std::map<double, int> expected = {{0.05, 0},  {0.02, 0},   {0.01, 0},   {0.006, 0},   {0.005, 1},
                                          {0.004, 1}, {0.0026, 1}, {0.0025, 2}, {0.00125, 3}, {0.0001, 3}};
  for (const auto& [voxel_size_m, log2] : expected) EXPECT_EQ(blockGroupLog2(voxel_size_m), log2) << voxel_size_m;
}

/// Batches of points at random places: blocks share a group exactly if their leaves are in one cube of leaves, and
/// numbers have no holes.
TEST(DeviceBlocks, NumberGroupsByPlace) {
  for (const int group_log2 : {0, 1, 2, 3}) {
    test::Random random(static_cast<std::uint64_t>(group_log2) + 1);
    SurfaceIndex index;
    DeviceBlocks blocks(group_log2);
    const std::int32_t edge = 8 << group_log2;  // [voxels]
    const auto floorOf = [edge](std::int32_t v) { return (v - ((v % edge) + edge) % edge) / edge; };
    std::map<Index3, std::uint32_t> group_at;
    std::set<std::uint32_t> numbers, told;
    std::uint32_t next_id = 0;
    std::vector<kernels::BlockDelta> deltas;
    std::vector<std::uint32_t> ids;
    for (int batch = 0; batch < 10; ++batch) {
      std::set<std::uint32_t> changed;
      for (int n = 0; n < 60; ++n) {
        const Index3 voxel = {random.between(-60, 60), random.between(-60, 60), random.between(-20, 20)};
        if (index.find(voxel) == kNone) changed.insert(index.insert(voxel, next_id++));
      }
      std::vector<std::uint32_t> in_any_order(changed.begin(), changed.end());
      if (batch % 2 == 1) std::ranges::reverse(in_any_order);
      blocks.deltas(in_any_order, index.blocks(), deltas, ids);
      ASSERT_EQ(deltas.size(), in_any_order.size());
      for (const kernels::BlockDelta& block : deltas) {
        ASSERT_EQ(block.is_new != 0, told.insert(block.block).second);
        if (block.is_new == 0) continue;
        const Index3 place = {floorOf(8 * block.leaf[0]), floorOf(8 * block.leaf[1]), floorOf(8 * block.leaf[2])};
        const auto [at, is_new] = group_at.try_emplace(place, block.group);
        ASSERT_EQ(at->second, block.group);
        ASSERT_EQ(numbers.insert(block.group).second, is_new) << "two places share a group";
      }
      ASSERT_EQ(blocks.groups(), numbers.size());
      ASSERT_EQ(*numbers.rbegin() + 1, numbers.size());
    }
    ASSERT_EQ(told.size(), index.blocks().size());
    if (group_log2 > 0) {
      EXPECT_LT(numbers.size(), told.size());
    }
  }
}

}  // namespace
}  // namespace accessvdb::internal
