// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Cells of a tool against counting its voxels cell by cell, for every direction and every place of the point.
#include "tool/tool_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <limits>
#include <tuple>

#include "hostdev/cell_counts.h"
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

SplitTool solidTool(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  SplitTool tool;
  VoxelSet odd, tall, plate, block;
  test::addBox(odd, {-13, -2, -9}, {-5, 8, -3});
  test::addBox(tall, {-3, 5, -70}, {1, 10, 79});
  tall.erase({-1, 7, 20});
  test::addBox(tall, {30, -1, -2}, {31, 1, 90});  // too thin for a cell
  test::addBox(plate, {-9, -9, 3}, {9, 9, 5});    // so is this
  test::addBox(block, {2, -7, -20}, {9, 0, 38});  // columns that fill their 64 bits, nearly
  tool.addDirection(odd, random);
  tool.addDirection(tall, random);
  tool.addDirection({}, random);
  tool.addDirection(plate, random);
  tool.addDirection(block, random);
  for (int n = 0; n < 4; ++n) tool.addDirection(raggedVoxels(random), random);
  return tool;
}

using MapCell = std::array<std::int32_t, 3>;

/// Cell of the map that holds a voxel.
MapCell cellOfVoxel(const std::array<std::int32_t, 3>& voxel) {
  MapCell cell;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int32_t v = voxel[axis];
    cell[axis] = (v - ((v % 4) + 4) % 4) / 4;
  }
  return cell;
}

/// Cells of the runs of direction d for a point, in order, one as often as it is listed.
std::vector<MapCell> listed(const CellRuns& runs, int d, const kernels::Coord& point) {
  const auto list = static_cast<std::size_t>(d * kernels::kCellPhases + kernels::cellPhase(point));
  const MapCell own = cellOfVoxel({point[0], point[1], point[2]});
  std::vector<MapCell> cells;
  for (std::uint32_t n = runs.begin[list]; n < runs.begin[list + 1]; ++n) {
    const kernels::CellRun& run = runs.runs[n];
    for (int bit = 0; bit < 16; ++bit) {
      if ((run.bits >> bit & 1) != 0) cells.push_back({own[0] + run.dx, own[1] + run.dy, own[2] + run.dz + bit});
    }
  }
  std::sort(cells.begin(), cells.end());
  return cells;
}

VoxelSet voxelsOf(const std::vector<kernels::VoxelColumn>& columns, std::uint32_t begin, std::uint32_t end) {
  VoxelSet voxels;
  for (std::uint32_t n = begin; n < end; ++n) {
    for (int bit = 0; bit < 64; ++bit) {
      if ((columns[n].bits >> bit & 1) != 0) voxels.insert({columns[n].dx, columns[n].dy, columns[n].dz + bit});
    }
  }
  return voxels;
}

/// A point somewhere in the map, its voxel at the place `phase` of its cell.
kernels::Coord somePoint(std::mt19937_64& random, int phase) {
  const auto base = [&] { return 4 * within(random, -50, 50); };
  return {base() + phase / 16, base() + phase / 4 % 4, base() + phase % 4};
}

TEST(ToolCells, AreTheCellsThatTheToolCoversAndThoseBesideThem) {
  std::mt19937_64 random(1);
  std::size_t num_inside = 0, num_beside = 0;
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const SplitTool tool = solidTool(seed);
    const int D = tool.numDirections();
    const ToolCells cells = ToolCells::make(tool.view(), D, kNoLimit);
    ASSERT_FALSE(cells.empty());
    ASSERT_EQ(cells.inner.size(), static_cast<std::size_t>(D));
    for (const CellRuns* runs : {&cells.inside, &cells.beside}) {
      ASSERT_EQ(runs->begin.size(), static_cast<std::size_t>(D * kernels::kCellPhases + 1));
      ASSERT_EQ(runs->begin.front(), 0u);
      ASSERT_EQ(runs->begin.back(), runs->runs.size());
    }
    for (int d = 0; d < D; ++d) {
      const auto at = static_cast<std::size_t>(d);
      const VoxelSet inner = voxelsOf(cells.columns, cells.inner[at], tool.begin[at + 1]);
      for (int phase = 0; phase < kernels::kCellPhases; ++phase) {
        const kernels::Coord point = somePoint(random, phase);
        const auto inMap = [&](const std::array<std::int32_t, 3>& v) {
          return cellOfVoxel({point[0] + v[0], point[1] + v[1], point[2] + v[2]});
        };
        std::map<MapCell, int> covered;
        for (const auto& v : tool.voxels[at]) ++covered[inMap(v)];
        std::vector<MapCell> inside, beside;
        for (const auto& [cell, count] : covered) {
          if (count == 64) inside.push_back(cell);
        }
        std::set<MapCell> touched;
        for (const auto& v : inner) touched.insert(inMap(v));
        for (const MapCell& cell : touched) {
          if (covered[cell] != 64) beside.push_back(cell);
        }
        ASSERT_EQ(listed(cells.inside, d, point), inside) << "direction " << d << " phase " << phase;
        ASSERT_EQ(listed(cells.beside, d, point), beside) << "direction " << d << " phase " << phase;
        num_inside += inside.size();
        num_beside += beside.size();
      }
    }
  }
  EXPECT_GT(num_inside, 10000u);
  EXPECT_GT(num_beside, 10000u);
}

TEST(ToolCells, OuterColumnsComeFirstNearOnesFirst) {
  const SplitTool tool = solidTool(4);
  ASSERT_GT(tool.split, 50);
  const ToolCells cells = ToolCells::make(tool.view(), tool.numDirections(), kNoLimit);
  ASSERT_EQ(cells.columns.size(), tool.columns.size());
  int outer = 0, inner = 0;
  for (std::size_t d = 0; d < tool.voxels.size(); ++d) {
    const std::uint32_t begin = tool.begin[d], end = tool.begin[d + 1];
    ASSERT_GE(cells.inner[d], begin);
    ASSERT_LE(cells.inner[d], end);
    // The columns of the tool, in another order.
    const auto sorted = [&](const std::vector<kernels::VoxelColumn>& columns) {
      std::vector<std::tuple<int, int, int, std::uint64_t>> all;
      for (std::uint32_t n = begin; n < end; ++n) {
        all.emplace_back(columns[n].dx, columns[n].dy, columns[n].dz, columns[n].bits);
      }
      std::sort(all.begin(), all.end());
      return all;
    };
    ASSERT_EQ(sorted(cells.columns), sorted(tool.columns)) << "direction " << d;
    // Voxels and places (x, y) of all cubes of 4 x 4 x 4 that are full: each is a cell for some point.
    VoxelSet in_cells;
    std::set<std::array<std::int32_t, 2>> places;
    for (const auto& v : tool.voxels[d]) {
      VoxelSet cube;
      test::addBox(cube, v, {v[0] + 3, v[1] + 3, v[2] + 3});
      const bool full =
          std::all_of(cube.begin(), cube.end(), [&](const auto& voxel) { return tool.voxels[d].contains(voxel); });
      if (!full) continue;
      in_cells.merge(cube);
      for (int i = 0; i < 16; ++i) places.insert({v[0] + i / 4, v[1] + i % 4});
    }
    for (const auto& v : voxelsOf(cells.columns, begin, cells.inner[d])) {
      ASSERT_FALSE(in_cells.contains(v)) << "direction " << d << ": " << v[0] << " " << v[1] << " " << v[2];
      ++outer;
    }
    for (std::uint32_t n = cells.inner[d]; n < end; ++n, ++inner) {
      ASSERT_TRUE(places.contains({cells.columns[n].dx, cells.columns[n].dy})) << "direction " << d;
    }
    const auto leavesAway = [&](std::uint32_t n) {
      const auto leaf = [](int v) { return v >= 0 ? v / 8 : -v / 8; };
      return std::max(leaf(cells.columns[n].dx), leaf(cells.columns[n].dy));
    };
    for (std::uint32_t n = begin + 1; n < cells.inner[d]; ++n) ASSERT_LE(leavesAway(n - 1), leavesAway(n));
  }
  EXPECT_GT(outer, 100);
  EXPECT_GT(inner, 100);
}

TEST(ToolCells, StayEmptyWhereTheyWouldTakeTooMuchMemory) {
  const SplitTool tool = solidTool(5);
  const ToolCells all = ToolCells::make(tool.view(), tool.numDirections(), kNoLimit);
  const std::uint64_t bytes = (all.inside.runs.size() + all.beside.runs.size()) * sizeof(kernels::CellRun);
  EXPECT_FALSE(ToolCells::make(tool.view(), tool.numDirections(), bytes).empty());
  for (const std::uint64_t most : {bytes - 1, bytes / 2, std::uint64_t{0}}) {
    const ToolCells none = ToolCells::make(tool.view(), tool.numDirections(), most);
    EXPECT_TRUE(none.empty()) << most << " of " << bytes;
    EXPECT_TRUE(none.columns.empty() && none.inside.runs.empty() && none.beside.runs.empty());
  }
}

TEST(ToolCells, StayEmptyForThinToolsAndSamples) {
  std::mt19937_64 random(6);
  SplitTool thin;
  VoxelSet plate, rod, cube;
  test::addBox(plate, {-20, -20, -2}, {20, 20, 0});
  test::addBox(rod, {-1, -1, -100}, {1, 1, 100});
  test::addBox(cube, {0, -5, 7}, {3, -2, 10});
  VoxelSet hollow = cube;
  hollow.erase({1, -4, 9});
  for (const VoxelSet* voxels : {&plate, &rod, &hollow}) thin.addDirection(*voxels, random);
  EXPECT_TRUE(ToolCells::make(thin.view(), thin.numDirections(), kNoLimit).empty());
  thin.addDirection(cube, random);
  EXPECT_FALSE(ToolCells::make(thin.view(), thin.numDirections(), kNoLimit).empty());  // one cell is enough

  const SplitTool tool = solidTool(7);
  kernels::ToolKernelView samples = tool.view();
  samples.use_samples = true;
  EXPECT_TRUE(ToolCells::make(samples, tool.numDirections(), kNoLimit).empty());
}

TEST(InnerRows, AreTheInnerColumnsInTilesOfTheMap) {
  const SplitTool tool = solidTool(11);
  const int directions = tool.numDirections();
  std::vector<std::vector<kernels::VoxelColumn>> inner(static_cast<std::size_t>(directions));
  for (int d = 0; d < directions; ++d) {
    for (std::uint32_t n = tool.begin[static_cast<std::size_t>(d)]; n < tool.begin[static_cast<std::size_t>(d) + 1];
         ++n) {
      // Others would be too high.
      const kernels::VoxelColumn& c = tool.columns[n];
      if (c.dz >= -26 && c.dz + 63 - std::countl_zero(c.bits) < -26 + 64)
        inner[static_cast<std::size_t>(d)].push_back(tool.columns[n]);
    }
  }
  const std::vector<std::span<const kernels::VoxelColumn>> spans(inner.begin(), inner.end());
  const InnerRows rows = InnerRows::make(spans);
  ASSERT_EQ(rows.boxes.size(), static_cast<std::size_t>(directions));
  std::size_t voxels = 0;
  for (int d = 0; d < directions; ++d) {
    VoxelSet expected;
    for (const kernels::VoxelColumn& c : inner[static_cast<std::size_t>(d)]) {
      for (int bit = 0; bit < 64; ++bit) {
        if ((c.bits >> bit & 1) != 0) expected.insert({c.dx, c.dy, c.dz + bit});
      }
    }
    voxels += expected.size();
    const kernels::InnerBox& box = rows.boxes[static_cast<std::size_t>(d)];
    for (int phase = 0; phase < 8; ++phase) {
      VoxelSet found;
      const auto list = static_cast<std::size_t>(d * 8 + phase);
      for (std::uint32_t n = rows.tile_begin[list]; n < rows.tile_begin[list + 1]; ++n) {
        const kernels::RowTile& tile = rows.tiles[n];
        ASSERT_EQ((tile.dy + phase) & 7, 0) << "a tile begins at a multiple of 8 in the map";
        for (int k = 0; k < 8; ++k) {
          const int y = tile.dy + k - box.dy;
          if (y < 0 || y >= box.size_y) continue;
          const std::uint64_t row =
              rows.rows[box.first + static_cast<std::size_t>((tile.dx - box.dx) * box.size_y + y)];
          for (int bit = 0; bit < 64; ++bit) {
            if ((row >> bit & 1) == 0) continue;
            ASSERT_TRUE(found.insert({tile.dx, tile.dy + k, box.dz + bit}).second) << "listed twice";
          }
        }
      }
      ASSERT_EQ(found, expected) << d << ", " << phase;
    }
  }
  EXPECT_GT(voxels, 1000u);
}

TEST(InnerRows, AreNotMadeOfColumnsHigherThanAWord) {
  const std::vector<kernels::VoxelColumn> high = {{0, 0, 0, 0, 1}, {0, 1, 64, 0, 1}};
  const std::vector<std::span<const kernels::VoxelColumn>> spans = {high};
  EXPECT_TRUE(InnerRows::make(spans).boxes.empty());
}

}  // namespace
}  // namespace accessvdb::internal
