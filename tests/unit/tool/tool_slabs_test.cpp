// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Slabs of a tool against its voxels, for every direction and every place of the point in its leaf.
#include "tool/tool_slabs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>

#include "unit/tool/split_tool.h"

namespace accessvdb::internal {
namespace {

using test::SplitTool;
using test::VoxelSet;
using test::within;

constexpr std::uint64_t kNoLimit = std::numeric_limits<std::uint64_t>::max();

/// Boxes that overlap, a few voxels missing, a few beside them.
VoxelSet raggedVoxels(std::mt19937_64& random) {
  VoxelSet voxels;
  for (int n = 0; n < 4; ++n) {
    std::array<std::int32_t, 3> low, high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = within(random, -14, 8);
      high[axis] = low[axis] + within(random, 3, 14);
    }
    test::addBox(voxels, low, high);
  }
  const auto some = [&] { return within(random, -16, 16); };
  for (int n = 0; n < 60; ++n) voxels.erase({some(), some(), some()});
  for (int n = 0; n < 60; ++n) voxels.insert({some(), some(), some()});
  return voxels;
}

/// Thick and thin, higher than a column, far from the point, and a direction without a voxel.
SplitTool mixedTool(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  SplitTool tool;
  VoxelSet odd, tall, plate, block;
  test::addBox(odd, {-13, -2, -9}, {-5, 8, -3});
  test::addBox(tall, {-3, 5, -70}, {1, 10, 79});
  tall.erase({-1, 7, 20});
  test::addBox(tall, {30, -1, -2}, {31, 1, 90});
  test::addBox(plate, {-19, -29, 3}, {29, 9, 5});
  test::addBox(block, {2, -7, -20}, {9, 0, 38});
  tool.addDirection(odd, random);
  tool.addDirection(tall, random);
  tool.addDirection({}, random);
  tool.addDirection(plate, random);
  tool.addDirection(block, random);
  for (int n = 0; n < 4; ++n) tool.addDirection(raggedVoxels(random), random);
  return tool;
}

std::int32_t floorOf8(std::int32_t v) { return v >= 0 ? v / 8 : -((7 - v) / 8); }

/// A column of slabs with its slabs, as a kernel finds them.
struct Listed {
  kernels::SlabColumn column;
  std::vector<std::uint64_t> slabs;
};
std::vector<Listed> listed(const ToolSlabs& slabs, std::size_t list) {
  std::vector<Listed> all;
  for (std::uint32_t group = slabs.group_begin[list]; group < slabs.group_begin[list + 1]; ++group) {
    for (std::size_t n = 0; n < kernels::kSlabGroup; ++n) {
      Listed one = {slabs.columns.at(group * kernels::kSlabGroup + n), {}};
      for (int k = 0; k < one.column.count; ++k) {
        const std::size_t row = static_cast<std::size_t>(k) * kernels::kSlabGroup;
        one.slabs.push_back(slabs.words.at(slabs.first_word.at(group) + row + n));
      }
      all.push_back(one);
    }
  }
  return all;
}

TEST(ToolSlabs, HoldEveryVoxelOnce) {
  std::mt19937_64 random(1);
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const SplitTool tool = mixedTool(seed);
    const auto directions = static_cast<std::size_t>(tool.numDirections());
    const ToolSlabs slabs = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
    ASSERT_EQ(slabs.group_begin.size(), 8 * directions + 1);
    ASSERT_EQ(slabs.group_begin.back(), slabs.first_word.size());
    ASSERT_EQ(slabs.columns.size(), slabs.first_word.size() * kernels::kSlabGroup);
    for (std::size_t d = 0; d < directions; ++d) {
      for (int phase = 0; phase < 8; ++phase) {
        // A point on either side of zero, its y at the place `phase` of its leaf.
        const std::int32_t point_y = 8 * within(random, -20, 20) + phase;
        VoxelSet found;
        for (const Listed& one : listed(slabs, 8 * d + static_cast<std::size_t>(phase))) {
          for (std::size_t k = 0; k < one.slabs.size(); ++k) {
            for (int bit = 0; bit < 64; ++bit) {
              if ((one.slabs[k] >> bit & 1) == 0) continue;
              const std::int32_t y = 8 * (floorOf8(point_y) + one.column.leaf_dy) + bit / 8;
              const std::int32_t z = 8 * (one.column.slab_dz + static_cast<std::int32_t>(k)) + bit % 8;
              ASSERT_TRUE(found.insert({one.column.dx, y - point_y, z}).second) << "twice";
            }
          }
        }
        ASSERT_EQ(found, tool.voxels[d]) << "direction " << d << " phase " << phase;
      }
    }
  }
}

TEST(ToolSlabs, AreNotEmptyAtEitherEndAndComeNearOnesFirst) {
  const SplitTool tool = mixedTool(4);
  const ToolSlabs slabs = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
  for (std::size_t list = 0; list + 1 < slabs.group_begin.size(); ++list) {
    int ring_before = 0;
    bool ended = false;
    for (const Listed& one : listed(slabs, list)) {
      ended = ended || one.column.count == 0;
      ASSERT_EQ(one.column.count == 0, ended) << "a column behind the ones that fill up the last group";
      if (ended) continue;
      ASSERT_NE(one.slabs.front(), 0u);
      ASSERT_NE(one.slabs.back(), 0u);
      const int ring = std::max(std::abs(floorOf8(std::abs(one.column.dx))), std::abs(int{one.column.leaf_dy}));
      ASSERT_GE(ring, ring_before);
      ring_before = ring;
    }
  }
}

TEST(ToolSlabs, StayEmptyWhereTheyWouldTakeTooMuchMemory) {
  const SplitTool tool = mixedTool(5);
  const ToolSlabs all = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
  const std::uint64_t bytes = all.columns.size() * sizeof(kernels::SlabColumn) +
                              all.words.size() * sizeof(std::uint64_t) + all.first_word.size() * sizeof(std::uint32_t);
  EXPECT_FALSE(ToolSlabs::make(tool.view(), tool.numDirections(), bytes).empty());
  for (const std::uint64_t most : {bytes - 1, bytes / 8, std::uint64_t{0}}) {
    const ToolSlabs none = ToolSlabs::make(tool.view(), tool.numDirections(), most);
    EXPECT_TRUE(none.empty() && none.words.empty() && none.columns.empty());
  }
}

TEST(ToolSlabs, StayEmptyForSamples) {
  const SplitTool tool = mixedTool(6);
  kernels::ToolKernelView samples = tool.view();
  samples.use_samples = true;
  EXPECT_TRUE(ToolSlabs::make(samples, tool.numDirections(), kNoLimit).empty());
}

}  // namespace
}  // namespace accessvdb::internal
