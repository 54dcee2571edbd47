// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Arcs by offset against the voxels of the tool, one by one.
#include "update/direction_arcs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <numbers>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "unit/tool/split_tool.h"

namespace accessvdb::internal {
namespace {

using kernels::ArcsOfColumn;
using kernels::ArcsTable;
using kernels::ArcsView;
using kernels::CoveringArc;
using test::SplitTool;
using test::VoxelSet;
using test::within;

/// A flat bar that turns with the direction, with a plate at one end of it.
SplitTool turningBar(int num_directions, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  SplitTool tool;
  for (int d = 0; d < num_directions; ++d) {
    VoxelSet voxels;
    const double yaw = 2 * std::numbers::pi * d / num_directions;
    for (double along = 0; along < 25; along += 0.5) {
      for (double across = -2; across <= 2; across += 0.5) {
        const auto x = static_cast<std::int32_t>(std::lround(along * std::cos(yaw) - across * std::sin(yaw)));
        const auto y = static_cast<std::int32_t>(std::lround(along * std::sin(yaw) + across * std::cos(yaw)));
        test::addBox(voxels, {x, y, -2}, {x, y, along > 20 ? 6 : 2});
      }
    }
    tool.addDirection(voxels, random);
  }
  return tool;
}

std::set<int> directionsOf(const CoveringArc& arc, int num_directions) {
  const auto directionAt = [](int place) { return place / 128 * 4 + place % 4; };
  std::set<int> directions;
  for (int d = directionAt(arc.begin); d != directionAt(arc.end); d = (d + 1) % num_directions) directions.insert(d);
  return directions;
}

/// @param x, y, z  from the lowest corner of the box
std::multiset<int> covering(const ArcsTable& arcs, int num_directions, int x, int y, int z) {
  const ArcsOfColumn& column = arcs.table[static_cast<std::size_t>(x * arcs.shape.size[1] + y)];
  std::multiset<int> directions;
  const auto add = [&](const CoveringArc& arc) {
    if (!arc.covers(static_cast<std::uint32_t>(z))) return;
    const std::set<int> of_arc = directionsOf(arc, num_directions);
    directions.insert(of_arc.begin(), of_arc.end());
  };
  add(column.first);
  add(column.second);
  for (std::size_t n = 0; n < column.count; ++n) add(arcs.more[column.more + n]);
  return directions;
}

/// Each direction once where its voxels are, and none elsewhere, the margin included.
void expectArcsOfAllVoxels(const SplitTool& tool) {
  const int directions = tool.numDirections();
  const DirectionArcs made(tool.view(), directions);
  const ArcsTable arcs = made.table();
  ASSERT_FALSE(arcs.table.empty());
  const ArcsView& shape = arcs.shape;
  std::int32_t reach_squared = 0;
  std::size_t covered = 0, further = 0;
  for (const ArcsOfColumn& column : arcs.table) further += column.count;
  EXPECT_LE(arcs.more.size(), std::max<std::size_t>(1, further)) << "columns share what they have in common";
  for (int x = 0; x < shape.size[0]; ++x) {
    for (int y = 0; y < shape.size[1]; ++y) {
      for (int z = 0; z < shape.size[2]; ++z) {
        const std::array<std::int32_t, 3> offset = {x + shape.low[0], y + shape.low[1], z + shape.low[2]};
        std::multiset<int> wanted;
        for (int d = 0; d < directions; ++d) {
          if (tool.voxels[static_cast<std::size_t>(d)].contains(offset)) wanted.insert(d);
        }
        ASSERT_EQ(covering(arcs, directions, x, y, z), wanted) << offset[0] << " " << offset[1] << " " << offset[2];
        if (wanted.empty()) continue;
        ++covered;
        reach_squared = std::max(reach_squared, offset[0] * offset[0] + offset[1] * offset[1]);
        for (const auto& [at, size] : {std::pair(x, shape.size[0]), std::pair(y, shape.size[1])}) {
          ASSERT_GE(at, ArcsView::kMargin);
          ASSERT_LT(at, size - ArcsView::kMargin);
        }
      }
    }
  }
  EXPECT_GT(covered, 500u);
  EXPECT_EQ(shape.reach_squared, reach_squared);
}

TEST(DirectionArcs, AreThoseOfEachVoxel) {
  for (const int directions : {4, 36, 90}) expectArcsOfAllVoxels(turningBar(directions, 1));
}

/// Everything in all directions: no arc is as long as the circle. And voxels here and there, so that columns have many.
TEST(DirectionArcs, MayBeAllDirectionsOrManyShortOnes) {
  std::mt19937_64 random(3);
  SplitTool tool;
  for (int d = 0; d < 40; ++d) {
    VoxelSet voxels;
    test::addBox(voxels, {-9, -9, -1}, {9, 9, 1});
    for (int n = 0; n < 3; ++n) voxels.insert({within(random, -2, 2), within(random, -2, 2), within(random, 3, 12)});
    tool.addDirection(voxels, random);
  }
  expectArcsOfAllVoxels(tool);
}

/// Counts that follow flips by steps of one byte, as a lane of a GPU adds them up, against counting again.
TEST(DirectionArcs, CarryCountsThroughFlips) {
  constexpr int kDirections = 90, kTogether = kernels::known_count::kMostTogether;
  const SplitTool tool = turningBar(kDirections, 2);
  const DirectionArcs made(tool.view(), kDirections);
  const ArcsTable arcs = made.table();
  ASSERT_FALSE(arcs.table.empty());
  std::mt19937_64 random(5);
  VoxelSet colliding;
  const auto count = [&](int d) {
    return std::ranges::count_if(tool.voxels[static_cast<std::size_t>(d)],
                                 [&](const auto& voxel) { return colliding.contains(voxel); });
  };
  std::vector<std::uint32_t> counts(kDirections, 0);
  std::int64_t highest = 0;
  for (int part = 0; part < 60; ++part) {
    std::vector<std::int8_t> steps(128 * 64, 0);
    int sum = 0;
    const auto add = [&](const CoveringArc& arc, int height, int by) {
      if (!arc.covers(static_cast<std::uint32_t>(height))) return;
      steps[arc.begin] = static_cast<std::int8_t>(steps[arc.begin] + by);
      steps[arc.end] = static_cast<std::int8_t>(steps[arc.end] - by);
      if (arc.end < arc.begin) sum += by;
    };
    for (int n = 0; n < kTogether; ++n) {
      // Near the axis, where all directions pass: steps add up most.
      const int reach = part % 2 == 0 ? 4 : 26;
      const std::array<std::int32_t, 3> voxel = {within(random, -reach, reach), within(random, -reach, reach),
                                                 within(random, -3, 7)};
      const bool collides = part < 40 ? colliding.insert(voxel).second : false;
      const int by = collides ? 1 : colliding.erase(voxel) != 0 ? -1 : 0;
      const int x = voxel[0] - arcs.shape.low[0], y = voxel[1] - arcs.shape.low[1], z = voxel[2] - arcs.shape.low[2];
      const ArcsOfColumn& column = arcs.table[static_cast<std::size_t>(x * arcs.shape.size[1] + y)];
      add(column.first, z, by);
      add(column.second, z, by);
      for (std::size_t further = 0; further < column.count; ++further) add(arcs.more[column.more + further], z, by);
    }
    for (int d = 0; d < kDirections; ++d) {
      sum += steps[kernels::stepPlace(d)];
      ASSERT_LE(std::abs(sum), kTogether);
      auto& mine = counts[static_cast<std::size_t>(d)];
      mine = kernels::known_count::changedBy(mine, static_cast<std::uint32_t>(sum) & 0xffffu);
      ASSERT_EQ(mine, static_cast<std::uint32_t>(count(d))) << "part " << part << " direction " << d;
      highest = std::max(highest, count(d));
    }
  }
  EXPECT_GT(highest, 100);
}

TEST(DirectionArcs, AreNoneWhereTheyWouldNotPayOrNotHold) {
  const SplitTool bar = turningBar(36, 1);
  kernels::ToolKernelView view = bar.view();
  view.use_samples = true;
  EXPECT_TRUE(DirectionArcs(view, 36).table().table.empty()) << "a sample's voxel depends on where the point lies";
  view = bar.view();
  view.parts = 2;
  EXPECT_TRUE(DirectionArcs(view, 36).table().table.empty()) << "rolls";
  view = bar.view();
  view.collision_limit = 20'000;
  EXPECT_TRUE(DirectionArcs(view, 36).table().table.empty()) << "bounds do not reach twice the limit";
  std::mt19937_64 random(4);
  SplitTool loose, tall;
  for (int d = 0; d < 36; ++d) {
    VoxelSet voxels;
    for (int n = 0; n < 60; ++n) voxels.insert({within(random, -2, 2), within(random, -2, 2), within(random, -20, 20)});
    loose.addDirection(voxels, random);
    VoxelSet pole;
    test::addBox(pole, {3, d % 3, -150}, {3, d % 3, 150});
    tall.addDirection(pole, random);
  }
  EXPECT_TRUE(DirectionArcs(loose.view(), 36).table().table.empty()) << "too many arcs above each other";
  EXPECT_TRUE(DirectionArcs(tall.view(), 36).table().table.empty()) << "too high";
  EXPECT_TRUE(DirectionArcs(SplitTool().view(), 0).table().table.empty());
}

}  // namespace
}  // namespace accessvdb::internal
