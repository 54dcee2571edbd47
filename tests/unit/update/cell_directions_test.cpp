// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Arcs of directions against walking over every voxel of the tool from every place of a group of leaves.
#include "update/cell_directions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <string>

#include "unit/tool/split_tool.h"

namespace accessvdb::internal {
namespace {

using test::SplitTool;
using test::VoxelSet;
using test::within;

constexpr std::uint64_t kAnySize = std::numeric_limits<std::uint64_t>::max();
constexpr std::size_t kMostDirections = 64 * kernels::kMaxDirectionWords;

/// A bar in every direction, some of them missing, some with a block elsewhere: without gaps along z, where
/// columns are not split.
SplitTool barTool(int num_directions, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  SplitTool tool;
  for (int d = 0; d < num_directions; ++d) {
    VoxelSet voxels;
    const double yaw = 2 * 3.141592653589793 * d / num_directions;
    if (within(random, 0, 4) != 0) {
      for (int along = 2; along < 24; along += 5) {
        const auto x = static_cast<std::int32_t>(std::lround(along * std::cos(yaw)));
        const auto y = static_cast<std::int32_t>(std::lround(along * std::sin(yaw)));
        test::addBox(voxels, {x, y, -3}, {x, y, -3 + within(random, 0, 3)});
      }
    }
    if (within(random, 0, 3) == 0) {
      const std::int32_t x = within(random, 24, 32), y = within(random, -32, -24), z = within(random, -30, 30);
      test::addBox(voxels, {x, y, z}, {x, y, z + within(random, 0, 2)});
    }
    if (d == num_directions / 3) test::addBox(voxels, {-31, 31, -60}, {-31, 31, 40});  // two pieces
    tool.addDirection(voxels, random);
  }
  return tool;
}

/// Single voxels, columns full of gaps.
SplitTool looseTool(int num_directions, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  SplitTool tool;
  for (int d = 0; d < num_directions; ++d) {
    VoxelSet voxels;
    for (int n = 0; n < 25; ++n) voxels.insert({within(random, -9, 3), within(random, -4, 7), within(random, -60, 60)});
    tool.addDirection(voxels, random);
  }
  return tool;
}

/// By cell, in cells from the group's first one: directions with a voxel in it from a place of the group.
std::map<Index3, std::bitset<kMostDirections>> coveringDirections(const SplitTool& tool, int group_log2) {
  std::map<Index3, std::bitset<kMostDirections>> covering;
  const auto floorOfQuarter = [](std::int32_t v) { return (v - ((v % 4) + 4) % 4) / 4; };
  for (std::size_t d = 0; d < tool.voxels.size(); ++d) {
    for (const auto& v : tool.voxels[d]) {
      // All places, one axis at a time: places of a group are all triples of places on the axes.
      std::array<std::set<std::int32_t>, 3> found;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        for (int place = 0; place < 8 << group_log2; ++place) found[axis].insert(floorOfQuarter(place + v[axis]));
      }
      for (const std::int32_t x : found[0]) {
        for (const std::int32_t y : found[1]) {
          for (const std::int32_t z : found[2]) covering[{x, y, z}].set(d);
        }
      }
    }
  }
  return covering;
}

/// How far after `first` direction d is, going up.
int behind(int first, int d, int num_directions) { return (d - first + num_directions) % num_directions; }

bool holds(const kernels::DirectionArc& arc, int d, int num_directions) {
  return behind(arc.first, d, num_directions) < arc.count;
}

/// Tries all first directions. @return size of the smallest arc that contains a set
int smallestCount(const std::bitset<kMostDirections>& set, int num_directions) {
  int smallest = set.none() ? 0 : num_directions;
  for (int first = 0; first < num_directions; ++first) {
    int count = 0;
    for (int d = 0; d < num_directions; ++d) {
      if (set.test(static_cast<std::size_t>(d))) count = std::max(count, behind(first, d, num_directions) + 1);
    }
    smallest = std::min(smallest, count);
  }
  return smallest;
}

/// Calls visit(cell, its arc) for all cells of the table.
template <class Visit>
void forEachCell(const CellDirections& cells, const Visit& visit) {
  std::size_t at = 0;
  for (std::int32_t x = 0; x < cells.size()[0]; ++x) {
    for (std::int32_t y = 0; y < cells.size()[1]; ++y) {
      for (std::int32_t z = 0; z < cells.size()[2]; ++z, ++at) {
        visit(Index3{x + cells.low()[0], y + cells.low()[1], z + cells.low()[2]}, cells.table()[at]);
      }
    }
  }
}

/// @param exact  the tool has no gaps along z, so that no direction is superfluous
void checkArcs(const SplitTool& tool, int group_log2, bool exact) {
  SCOPED_TRACE("group of 2^" + std::to_string(group_log2) + " leaves");
  const int D = tool.numDirections();
  const CellDirections cells(tool.view(), D, group_log2, false, kAnySize);
  ASSERT_FALSE(cells.empty());
  ASSERT_EQ(cells.table().size(), static_cast<std::size_t>(cells.size()[0]) *
                                      static_cast<std::size_t>(cells.size()[1]) *
                                      static_cast<std::size_t>(cells.size()[2]));
  auto covering = coveringDirections(tool, group_log2);
  Index3 low = covering.begin()->first, high = low;
  for (const auto& [cell, set] : covering) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], cell[axis]);
      high[axis] = std::max(high[axis], cell[axis]);
    }
  }
  ASSERT_EQ(cells.low(), low);
  ASSERT_EQ(cells.size(), (Index3{high[0] - low[0] + 1, high[1] - low[1] + 1, high[2] - low[2] + 1}));
  int around_zero = 0, partial = 0, none = 0;
  forEachCell(cells, [&](const Index3& cell, const kernels::DirectionArc& arc) {
    const std::bitset<kMostDirections>& set = covering[cell];
    ASSERT_LT(int{arc.first}, D);
    ASSERT_LE(int{arc.count}, D);
    for (int d = 0; d < D; ++d) {
      if (!set.test(static_cast<std::size_t>(d))) continue;
      ASSERT_TRUE(holds(arc, d, D)) << cell[0] << " " << cell[1] << " " << cell[2] << " direction " << d;
    }
    if (exact) {
      ASSERT_EQ(int{arc.count}, smallestCount(set, D)) << cell[0] << " " << cell[1] << " " << cell[2];
    }
    if (arc.count == 0) ++none;
    if (arc.first + arc.count > D) ++around_zero;
    if (arc.count > 1 && arc.count < D) ++partial;
  });
  if (!exact || D < 8) return;
  EXPECT_GT(around_zero, 0);
  EXPECT_GT(partial, 0);
  EXPECT_GT(none, 0);
}

TEST(CellDirections, AreTheSmallestArcs) {
  for (const int D : {1, 2, 3, 20, 64, 65}) {
    SCOPED_TRACE(D);
    for (const int group_log2 : {0, 1, 2, 3}) checkArcs(barTool(D, static_cast<std::uint64_t>(D)), group_log2, true);
  }
}

TEST(CellDirections, AreTheSmallestArcsOfTheMostDirections) {
  const SplitTool tool = barTool(256, 1);
  ASSERT_GT(tool.split, 0);
  checkArcs(tool, 0, true);
  checkArcs(tool, 1, true);
}

TEST(CellDirections, MissNoVoxelOfColumnsWithGaps) {
  for (const std::uint64_t seed : {1u, 2u}) {
    for (const int group_log2 : {0, 1, 2}) checkArcs(looseTool(24, seed), group_log2, false);
  }
}

/// Directions of any kind: sets, not arcs, and nothing superfluous.
TEST(CellDirections, OfAnyKindAreTheSets) {
  for (const int D : {1, 20, 65, 256}) {
    SCOPED_TRACE(D);
    const SplitTool tool = barTool(D, static_cast<std::uint64_t>(D) + 7);
    for (const int group_log2 : {0, 1}) {
      const CellDirections cells(tool.view(), D, group_log2, true, kAnySize);
      ASSERT_FALSE(cells.empty());
      ASSERT_TRUE(cells.table().empty());
      auto covering = coveringDirections(tool, group_log2);
      std::size_t at = 0, some = 0;
      for (std::int32_t x = 0; x < cells.size()[0]; ++x) {
        for (std::int32_t y = 0; y < cells.size()[1]; ++y) {
          for (std::int32_t z = 0; z < cells.size()[2]; ++z, ++at) {
            const auto& set = covering[{x + cells.low()[0], y + cells.low()[1], z + cells.low()[2]}];
            for (int d = 0; d < D; ++d) {
              ASSERT_EQ(cells.sets()[at].test(d), set.test(static_cast<std::size_t>(d))) << d;
              some += set.test(static_cast<std::size_t>(d)) ? 1 : 0;
            }
          }
        }
      }
      ASSERT_EQ(at, cells.sets().size());
      EXPECT_GT(some, 0u);
    }
  }
}

/// Every set of few directions, each direction with or without its one voxel.
TEST(CellDirections, AreTheSmallestArcsOfAllSets) {
  constexpr int kFew = 7;
  std::mt19937_64 random(3);
  for (int bits = 1; bits < 1 << kFew; ++bits) {
    SplitTool tool;
    std::bitset<kMostDirections> set;
    for (int d = 0; d < kFew; ++d) {
      VoxelSet voxels;
      if ((bits >> d & 1) != 0) {
        voxels.insert({-3, 5, 2});
        set.set(static_cast<std::size_t>(d));
      }
      tool.addDirection(voxels, random);
    }
    const CellDirections cells(tool.view(), kFew, 0, false, kAnySize);
    ASSERT_FALSE(cells.empty());
    for (const kernels::DirectionArc& arc : cells.table()) {
      ASSERT_EQ(int{arc.count}, smallestCount(set, kFew)) << bits;
      for (int d = 0; d < kFew; ++d) {
        ASSERT_TRUE(!set.test(static_cast<std::size_t>(d)) || holds(arc, d, kFew)) << bits;
      }
    }
  }
}

TEST(CellDirections, StayEmptyWhereTheyWouldBeTooLargeAndForSamples) {
  const SplitTool tool = barTool(20, 4);
  const CellDirections all(tool.view(), 20, 0, false, kAnySize);
  const std::uint64_t bytes = all.table().size() * sizeof(DirectionMask);  // while it is made
  ASSERT_GT(bytes, 0u);
  EXPECT_FALSE(CellDirections(tool.view(), 20, 0, false, bytes).empty());
  EXPECT_TRUE(CellDirections(tool.view(), 20, 0, false, bytes - 1).empty());
  EXPECT_TRUE(CellDirections(tool.view(), 20, 0, false, 0).empty());
  kernels::ToolKernelView samples = tool.view();
  samples.use_samples = true;
  EXPECT_TRUE(CellDirections(samples, 20, 0, false, kAnySize).empty());
  std::mt19937_64 random(5);
  SplitTool nothing;
  for (int d = 0; d < 20; ++d) nothing.addDirection({}, random);
  EXPECT_TRUE(CellDirections(nothing.view(), 20, 0, false, kAnySize).empty());
}

}  // namespace
}  // namespace accessvdb::internal
