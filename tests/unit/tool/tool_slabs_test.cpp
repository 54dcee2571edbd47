// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Slabs of a tool against its voxels, for every direction and every position of the point in its leaf.
#include "tool/tool_slabs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "unit/tool/split_tool.h"

namespace accessvdb::internal {
namespace {

using test::SplitTool;
using test::VoxelSet;
using test::within;

constexpr std::uint64_t kMost = std::numeric_limits<std::uint64_t>::max();
constexpr ToolSlabs::Limits kNoLimit = {kMost, kMost};

/// Overlapping boxes, with a few voxels missing and a few extra beside them.
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

using Leaf = std::array<std::int32_t, 3>;

/// The slab of a box at x, y, z of it.
std::uint64_t slabIn(const ToolSlabs& slabs, const kernels::SlabBox& box, int x, int y, int z) {
  const auto at = static_cast<std::uint32_t>(y * box.size_x + x);
  if (slabs.rows.empty()) {
    const std::uint32_t row = box.first + at * (static_cast<std::uint32_t>(box.size_z) + 1);
    // A kernel reads a slab below the row and one above it.
    EXPECT_EQ(slabs.words.at(row - 1), 0u);
    EXPECT_EQ(slabs.words.at(row + static_cast<std::uint32_t>(box.size_z)), 0u);
    return slabs.words.at(row + static_cast<std::uint32_t>(z));
  }
  const kernels::SlabRow& row = slabs.rows.at(box.first + at);
  if (z < row.begin || z >= row.begin + row.count) return 0;
  return slabs.words.at(row.first + static_cast<std::uint32_t>(z - row.begin));
}

/// Voxels of direction d relative to the point, read as a kernel reads them. @param point_y  y of its voxel
VoxelSet voxelsIn(const ToolSlabs& slabs, std::size_t d, std::int32_t point_y) {
  const std::int32_t leaf_y = floorOf8(point_y);
  const kernels::SlabBox& box = slabs.boxes.at(8 * d + static_cast<std::size_t>(point_y - 8 * leaf_y));
  VoxelSet voxels;
  for (int y = 0; y < box.size_y; ++y) {
    for (int x = 0; x < box.size_x; ++x) {
      for (int z = 0; z < box.size_z; ++z) {
        const std::uint64_t slab = slabIn(slabs, box, x, y, z);
        for (int bit = 0; bit < 64; ++bit) {
          if ((slab >> bit & 1) == 0) continue;
          voxels.insert(
              {x + box.dx, 8 * (leaf_y + y + box.leaf_dy) + bit / 8 - point_y, 8 * (z + box.slab_dz) + bit % 8});
        }
      }
    }
  }
  return voxels;
}

/// A leaf of the map that a kernel reads for a point.
struct Asked {
  Leaf leaf = {};
  bool column_first = false;  ///< its column has full slabs, so it comes before those without
  bool full = false;          ///< the tool takes all of it
};

/// The leaves in order.
std::vector<Asked> leavesFor(const ToolSlabs& slabs, std::size_t d, const Leaf& point) {
  Leaf own, place;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    own[axis] = floorOf8(point[axis]);
    place[axis] = point[axis] - 8 * own[axis];
  }
  const kernels::SlabBox& box = slabs.boxes.at(8 * d + static_cast<std::size_t>(place[1]));
  const auto list = 64 * d + 8 * static_cast<std::size_t>(place[0]) + static_cast<std::size_t>(place[1]);
  std::vector<Asked> leaves;
  for (std::uint32_t n = slabs.begin.at(list); n < slabs.begin.at(list + 1); ++n) {
    const kernels::LeafColumn& c = slabs.columns.at(n);
    const int one_more = place[2] != 0 ? 1 : 0;
    const int leaf_x = floorOf8(point[0] + box.dx + c.x - 8);
    EXPECT_EQ(8 * leaf_x, point[0] + box.dx + c.x - 8) << "not the first x of a leaf";
    for (int k = 0; k < c.count + one_more; ++k) {
      leaves.push_back({{leaf_x, own[1] + box.leaf_dy + c.y, own[2] + box.slab_dz + c.z + k},
                        c.num_full > 0,
                        k >= c.full + one_more && k < c.full + c.num_full});
    }
  }
  return leaves;
}

/// Voxels of the tool in each leaf that it touches.
std::map<Leaf, int> voxelsByLeaf(const VoxelSet& voxels, const Leaf& point) {
  std::map<Leaf, int> leaves;
  for (const auto& v : voxels) {
    ++leaves[{floorOf8(point[0] + v[0]), floorOf8(point[1] + v[1]), floorOf8(point[2] + v[2])}];
  }
  return leaves;
}

/// Thick enough that the tool takes many leaves as a whole, with a hole that splits some columns.
SplitTool thickTool() {
  std::mt19937_64 random(7);
  SplitTool tool;
  VoxelSet block, split;
  test::addBox(block, {-20, -17, -25}, {23, 22, 18});
  test::addBox(split, {-3, -21, -9}, {39, 14, 58});
  split.erase({11, 3, 20});
  tool.addDirection(block, random);
  tool.addDirection(split, random);
  return tool;
}

TEST(ToolSlabs, HoldTheVoxels) {
  std::mt19937_64 random(1);
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const SplitTool tool = mixedTool(seed);
    const auto directions = static_cast<std::size_t>(tool.numDirections());
    const ToolSlabs slabs = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
    ASSERT_EQ(slabs.boxes.size(), 8 * directions);
    for (std::size_t d = 0; d < directions; ++d) {
      for (int y = 0; y < 8; ++y) {
        // A point on either side of zero, its y at the place `y` of its leaf.
        ASSERT_EQ(voxelsIn(slabs, d, 8 * within(random, -20, 20) + y), tool.voxels[d]) << "direction " << d;
      }
    }
  }
}

/// The parts of a tool that rolls, by row: the same voxels and columns as if they were directions, in less memory.
TEST(ToolSlabs, HoldThePartsOfAToolThatRollsByRow) {
  const SplitTool tool = mixedTool(4);
  const int parts = tool.numDirections();
  ASSERT_GT(parts, 1);
  kernels::ToolKernelView rolling = tool.view();
  rolling.parts = parts;
  const ToolSlabs by_box = ToolSlabs::make(tool.view(), parts, kNoLimit);
  const ToolSlabs by_row = ToolSlabs::make(rolling, 1, kNoLimit);
  EXPECT_FALSE(by_row.rows.empty());
  EXPECT_TRUE(by_box.rows.empty());
  // Words of equal rows are kept once.
  std::map<std::vector<std::uint64_t>, std::uint32_t> first_of;
  std::size_t words = 0, shared = 0;
  for (const kernels::SlabRow& row : by_row.rows) {
    if (row.count == 0) continue;
    const auto begin = by_row.words.begin() + row.first;
    const auto [known, is_new] = first_of.try_emplace({begin, begin + row.count}, row.first);
    EXPECT_EQ(known->second, row.first);
    words += is_new ? row.count : 0u;
    shared += is_new ? 0u : 1u;
  }
  EXPECT_EQ(words, by_row.words.size());
  EXPECT_GT(shared, 20u);
  ASSERT_EQ(by_row.boxes.size(), 8 * static_cast<std::size_t>(parts));
  for (std::size_t part = 0; part < static_cast<std::size_t>(parts); ++part) {
    for (int y = 0; y < 8; ++y) ASSERT_EQ(voxelsIn(by_row, part, y), tool.voxels[part]) << "part " << part;
  }
  EXPECT_EQ(by_row.begin, by_box.begin);
  EXPECT_LT(by_row.words.size(), by_box.words.size() / 2);
  for (const std::uint64_t word : {by_row.words.front(), by_row.words.back()}) EXPECT_NE(word, 0u);
}

/// Boxes above their limit are kept by row as well, with the same voxels and columns.
TEST(ToolSlabs, AreKeptByRowWhereTheirBoxesWouldBeLarge) {
  const SplitTool tool = thickTool();
  const ToolSlabs by_box = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
  const std::uint64_t box_bytes = (by_box.words.size() - 1) * sizeof(std::uint64_t);
  EXPECT_TRUE(ToolSlabs::make(tool.view(), tool.numDirections(), {kMost, box_bytes}).rows.empty());
  const ToolSlabs by_row = ToolSlabs::make(tool.view(), tool.numDirections(), {kMost, box_bytes - 1});
  ASSERT_FALSE(by_row.rows.empty());
  EXPECT_LT(by_row.words.size(), by_box.words.size());
  EXPECT_EQ(by_row.begin, by_box.begin);
  EXPECT_EQ(by_row.thick, by_box.thick);
  for (std::size_t d = 0; d < tool.voxels.size(); ++d) {
    for (int y = 0; y < 8; ++y) ASSERT_EQ(voxelsIn(by_row, d, y), tool.voxels[d]) << "direction " << d;
  }
}

/// Points at places of a leaf, near and far from the origin. @param step  1: at all positions
template <typename Check>
void forEachPlace(std::mt19937_64& random, int step, const Check& check) {
  for (int phase = 0; phase < 512; phase += step) {
    const auto at = [&](int place) { return 8 * within(random, -20, 20) + place; };
    check(Leaf{at(phase / 64), at(phase / 8 % 8), at(phase % 8)});
  }
}

TEST(ToolSlabs, NameEveryLeafThatTheToolTouchesOnceFullOnesAndNearOnesFirst) {
  std::mt19937_64 random(2);
  std::size_t num_asked = 0, num_in_order = 0;
  for (const SplitTool& tool : {mixedTool(1), mixedTool(2), thickTool()}) {
    const auto directions = static_cast<std::size_t>(tool.numDirections());
    const ToolSlabs slabs = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
    ASSERT_EQ(slabs.begin.size(), 64 * directions + 1);
    ASSERT_EQ(slabs.begin.back(), slabs.columns.size());
    for (std::size_t d = 0; d < directions; ++d) {
      forEachPlace(random, !slabs.thick ? 1 : 7, [&](const Leaf& point) {
        std::map<Leaf, int> touched = voxelsByLeaf(tool.voxels[d], point);
        std::set<Leaf> asked;
        std::pair<bool, int> before = {false, 0};
        for (const Asked& a : leavesFor(slabs, d, point)) {
          ASSERT_TRUE(asked.insert(a.leaf).second) << "a leaf twice";
          const int ring = std::max(std::abs(a.leaf[0] - floorOf8(point[0])), std::abs(a.leaf[1] - floorOf8(point[1])));
          if (slabs.thick) {
            ASSERT_GE(std::pair(!a.column_first, ring), before);
            before = {!a.column_first, ring};
            ++num_in_order;
          }
          touched.erase(a.leaf);
        }
        ASSERT_TRUE(touched.empty()) << "direction " << d;
        num_asked += asked.size();
      });
    }
  }
  EXPECT_GT(num_asked, 10000u);
  EXPECT_GT(num_in_order, 10000u);
}

TEST(ToolSlabs, TellWhichLeavesTheToolTakesAsAWhole) {
  std::mt19937_64 random(3);
  const SplitTool tool = thickTool();
  const ToolSlabs slabs = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
  ASSERT_TRUE(slabs.thick);
  std::size_t full = 0, missed = 0;
  for (std::size_t d = 0; d < tool.voxels.size(); ++d) {
    forEachPlace(random, 7, [&](const Leaf& point) {
      const std::map<Leaf, int> leaves = voxelsByLeaf(tool.voxels[d], point);
      for (const Asked& a : leavesFor(slabs, d, point)) {
        const auto leaf = leaves.find(a.leaf);
        const bool is_full = leaf != leaves.end() && leaf->second == 512;
        if (a.full) {
          ASSERT_TRUE(is_full) << "direction " << d;
        }
        full += a.full ? 1 : 0;
        missed += is_full && !a.full ? 1 : 0;
      }
    });
  }
  EXPECT_GT(full, 10000u);
  // For a column with a hole, only the longer run is listed, and no leaf at the end of a run, which a slab that is not
  // full may cover as well.
  EXPECT_LT(missed, full / 4);
  EXPECT_GT(missed, 0u);
}

TEST(ToolSlabs, DoNotLookForFullLeavesOfThinTools) {
  std::mt19937_64 random(4);
  SplitTool tool;
  VoxelSet plate;
  test::addBox(plate, {-19, -29, 3}, {29, 9, 12});
  tool.addDirection(plate, random);
  const ToolSlabs slabs = ToolSlabs::make(tool.view(), 1, kNoLimit);
  EXPECT_FALSE(slabs.empty());
  EXPECT_FALSE(slabs.thick);
}

TEST(ToolSlabs, StayEmptyWhereTheyWouldTakeTooMuchMemory) {
  const SplitTool tool = mixedTool(5);
  const ToolSlabs all = ToolSlabs::make(tool.view(), tool.numDirections(), kNoLimit);
  const std::uint64_t bytes =
      all.columns.size() * sizeof(kernels::LeafColumn) + (all.words.size() - 1) * sizeof(std::uint64_t);
  EXPECT_FALSE(ToolSlabs::make(tool.view(), tool.numDirections(), {bytes, kMost}).empty());
  for (const std::uint64_t most : {bytes - 1, bytes / 8, std::uint64_t{0}}) {
    const ToolSlabs none = ToolSlabs::make(tool.view(), tool.numDirections(), {most, kMost});
    EXPECT_TRUE(none.empty() && none.words.empty() && none.columns.empty());
  }
}

/// Boxes larger than the limit, or wider than their numbers can represent.
TEST(ToolSlabs, StayEmptyForToolsThatAreVeryLong) {
  const std::uint32_t begin[] = {0, 2};
  for (const std::int16_t end : {std::int16_t{21000}, std::int16_t{14000}}) {
    const kernels::VoxelColumn ends[] = {{static_cast<std::int16_t>(-end), static_cast<std::int16_t>(-end), 0, 0, 1},
                                         {end, end, 0, 0, 1}};
    kernels::ToolKernelView tool;
    tool.columns = ends;
    tool.column_begin = begin;
    EXPECT_TRUE(ToolSlabs::make(tool, 1, {1 << 20, kMost}).empty()) << end;
    if (end > 20000) {
      EXPECT_TRUE(ToolSlabs::make(tool, 1, kNoLimit).empty()) << end;
    }
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
