// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The minimum over the rolls of a direction, behind a core, against a plain loop over voxels and rolls.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "cpu/map_window.h"
#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

using kernels::AxisCount;
using VoxelSet = std::set<Voxel>;

constexpr int kAxes = 12;

/// A tool of random voxels, by direction and roll, and its parts.
struct RollingTool {
  std::vector<std::vector<VoxelSet>> rolls;  ///< [D][R]
  ToolFixture parts;

  /// @param height  voxels  @param spoil  adds a voxel to each core that not all rolls have
  RollingTool(std::mt19937_64& random, int num_rolls, int height, bool spoil = false) {
    const auto randomVoxel = [&] {
      return Voxel{below(random, 17) - 8, below(random, 17) - 8, below(random, height) - height / 2};
    };
    for (int d = 0; d < kAxes; ++d) {
      VoxelSet shared;
      for (int n = below(random, 150); n > 0; --n) shared.insert(randomVoxel());
      std::vector<VoxelSet>& of_direction = rolls.emplace_back();
      for (int roll = 0; roll < num_rolls; ++roll) {
        VoxelSet& voxels = of_direction.emplace_back(shared);
        for (int n = below(random, 4) == 0 ? 0 : below(random, 200); n > 0; --n) voxels.insert(randomVoxel());
      }
      VoxelSet core = of_direction[0];
      for (const VoxelSet& voxels : of_direction) {
        std::erase_if(core, [&](const Voxel& voxel) { return !voxels.contains(voxel); });
      }
      if (spoil) {
        for (const VoxelSet& voxels : of_direction) {
          const auto other = std::ranges::find_if(voxels, [&](const Voxel& voxel) { return !core.contains(voxel); });
          if (other == voxels.end()) continue;
          core.insert(*other);
          break;
        }
      }
      add(core);
      for (const VoxelSet& voxels : of_direction) {
        VoxelSet rest;
        std::ranges::set_difference(voxels, core, std::inserter(rest, rest.end()));
        add(rest);
      }
    }
  }

  [[nodiscard]] kernels::ToolKernelView view() const {
    kernels::ToolKernelView tool = parts.view(1);
    tool.parts = static_cast<int>(rolls[0].size()) + 1;
    return tool;
  }

 private:
  void add(const VoxelSet& voxels) {
    std::map<std::array<std::int32_t, 3>, std::uint64_t> columns;
    for (const auto& [x, y, z] : voxels) columns[{x, y, z >> 4 << 4}] |= std::uint64_t{1} << (z & 15);
    for (const auto& [place, bits] : columns) parts.columns.push_back(column(place[0], place[1], place[2], bits));
    parts.endDirection();
  }
};

AxisCount plainLoop(const OccupancyFixture& map, const std::vector<VoxelSet>& rolls, const Voxel& at) {
  AxisCount least = {1 << 30, 0};
  for (std::size_t roll = 0; roll < rolls.size(); ++roll) {
    int count = 0;
    for (const auto& [x, y, z] : rolls[roll]) count += map.collides({at[0] + x, at[1] + y, at[2] + z}) ? 1 : 0;
    if (count < least.count) least = {count, static_cast<int>(roll)};
  }
  return least;
}

/// Exact up to the bound; otherwise more than that, which every roll reaches.
bool isRight(const AxisCount& found, const AxisCount& expected, int stop_above) {
  if (expected.count <= stop_above) return found.count == expected.count && found.roll == expected.roll;
  return found.count > stop_above && found.count <= expected.count && found.roll == 0;
}

struct Differences {
  int points = 0, wrong = 0;
  int exact = 0, stopped = 0, later_roll = 0, free = 0;
};

/// By voxels of the map and by windows of bits, at random points.
Differences compare(std::uint64_t seed, bool spoil) {
  std::mt19937_64 random(seed);
  Differences out;
  const kernels::WindowKernelList sets = kernels::runnableWindowKernels();
  for (int round = 0; round < 25; ++round) {
    OccupancyFixture map;
    const ApproachFixture approach(kAxes, {1.0});
    const int dense = round % 5;
    for (int n = 0; n < 400 << (2 * dense / 2); ++n) {
      map.collide({below(random, 48) - 24, below(random, 48) - 24, below(random, 120) - 60});
    }
    const kernels::OccupancyReader reader = map.reader();
    const RollingTool tool(random, 2 + below(random, 9), round % 3 == 0 ? 120 : 40, spoil);
    const kernels::ToolKernelView view = tool.view();
    const kernels::WindowedTool windowed(view, approach.view, map.inverseVoxelSize());
    kernels::MapWindow window(windowed, *sets.kernels[round % sets.count]);
    for (int n = 0; n < 400; ++n, ++out.points) {
      const Voxel at = {below(random, 24) - 12, below(random, 24) - 12, below(random, 60) - 30};
      const int d = below(random, kAxes);
      const AxisCount expected = plainLoop(map, tool.rolls[static_cast<std::size_t>(d)], at);
      const int stop = below(random, 3) == 0 ? 1 << 29 : below(random, expected.count + 4);
      const float p[3] = {static_cast<float>(at[0]), static_cast<float>(at[1]), static_cast<float>(at[2])};
      const AxisCount by_map =
          kernels::MapTests{reader, view, approach.view, p, map.inverseVoxelSize()}.collisions(d, stop);
      const kernels::Coord ijk(at[0], at[1], at[2]);
      window.moveTo(reader, kernels::Coord(at[0] >> 3, at[1] >> 3, at[2] >> 3));
      window.standAt(p, ijk, map.inverseVoxelSize());
      const AxisCount by_window =
          kernels::countAxis(view.parts, d, stop, [&](int part, int bound) { return window.countVoxels(part, bound); });
      const bool right = isRight(by_map, expected, stop) && isRight(by_window, expected, stop);
      out.wrong += right ? 0 : 1;
      out.exact += expected.count <= stop ? 1 : 0;
      out.stopped += expected.count > stop ? 1 : 0;
      out.later_roll += expected.roll > 0 ? 1 : 0;
      out.free += expected.count == 0 ? 1 : 0;
    }
  }
  return out;
}

TEST(AxisCount, IsTheLeastOfAllRollsAndTheFirstThatHasIt) {
  const Differences found = compare(5, false);
  EXPECT_EQ(found.points, 10000);
  EXPECT_EQ(found.wrong, 0);
  EXPECT_GT(found.exact, 3000);
  EXPECT_GT(found.stopped, 500);
  EXPECT_GT(found.later_roll, 2000);
  EXPECT_GT(found.free, 100);
}

/// The comparison above would notice.
TEST(AxisCount, IsWrongWithACoreThatIsOneVoxelTooLarge) { EXPECT_GT(compare(5, true).wrong, 50); }

TEST(AxisCount, OfOneRollIsTheCount) {
  const auto count = [](int part, int stop_above) { return 100 * part + stop_above; };
  const AxisCount found = kernels::countAxis(1, 7, 5, count);
  EXPECT_EQ(found.count, 705);
  EXPECT_EQ(found.roll, 0);
}

/// What follows a roll that only has the core's collisions is not counted.
TEST(AxisCount, StopsAtTheCore) {
  std::vector<int> asked;
  const std::array<int, 5> hits = {3, 4, 0, 0, 9};
  const AxisCount found = kernels::countAxis(5, 0, 100, [&](int part, int) {
    asked.push_back(part);
    return hits[static_cast<std::size_t>(part)];
  });
  EXPECT_EQ(found.count, 3);
  EXPECT_EQ(found.roll, 1);
  EXPECT_EQ(asked, (std::vector<int>{0, 1, 2}));
  asked.clear();
  const AxisCount settled = kernels::countAxis(5, 0, 2, [&](int part, int) {
    asked.push_back(part);
    return hits[static_cast<std::size_t>(part)];
  });
  EXPECT_EQ(settled.count, 3);
  EXPECT_EQ(asked, std::vector<int>{0});  // the core settles all rolls
}

}  // namespace
}  // namespace accessvdb::test
