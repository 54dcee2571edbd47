// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Bit windows of the CPU backend. The oracle looks at one voxel at a time.
#include "cpu/map_window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <random>

#include "tests/unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

using kernels::MapWindow;
using kernels::WindowedTool;
using kernels::WindowKernels;
using kernels::WindowRun;

TEST(WindowKernels, CountAsBitByBitOnEverySet) {
  std::mt19937_64 random(1);
  const kernels::WindowKernelList sets = kernels::runnableWindowKernels();
  ASSERT_GE(sets.count, 1);
  for (int round = 0; round < 400; ++round) {
    std::vector<std::uint64_t> map(300), above(300), tool(300);
    for (auto* words : {&map, &above, &tool}) {
      for (std::uint64_t& word : *words) word = random() & random();
    }
    std::vector<WindowRun> runs;
    std::uint32_t first = 0;
    for (int n = below(random, 12); n > 0; --n) {
      const auto count = static_cast<std::uint32_t>(1 + below(random, 20));
      runs.push_back({below(random, 40) - 20, first, count});
      first += count;
    }
    const auto shift = static_cast<unsigned>(below(random, 64));
    constexpr int kPoint = 100;  // so that offsets may be negative
    int expected = 0, expected_two = 0;
    for (const WindowRun& run : runs) {
      for (std::uint32_t n = 0; n < run.count; ++n) {
        const auto at = static_cast<std::size_t>(kPoint + run.offset) + n;
        for (unsigned bit = 0; bit < 64; ++bit) {
          if ((tool[run.first + n] >> bit & 1u) == 0) continue;
          const unsigned z = bit + shift;
          if (z < 64 && (map[at] >> z & 1u) != 0) ++expected, ++expected_two;
          if (z >= 64 && (above[at] >> (z - 64) & 1u) != 0) ++expected_two;
        }
      }
    }
    const int stop = below(random, 3) == 0 ? below(random, expected_two + 2) : 1 << 30;
    for (int n = 0; n < sets.count; ++n) {
      const WindowKernels& set = *sets.kernels[n];
      SCOPED_TRACE(set.name);
      const WindowRun *const begin = runs.data(), *const end = begin + runs.size();
      const int one = set.count(begin, end, tool.data(), map.data() + kPoint, shift, stop);
      const int two = set.count_two(begin, end, tool.data(), map.data() + kPoint, above.data() + kPoint, shift, stop);
      const auto holds = [stop](int counted, int exact) {
        return exact <= stop ? counted == exact : counted > stop && counted <= exact;
      };
      ASSERT_TRUE(holds(one, expected)) << one << " of " << expected << ", stop " << stop;
      ASSERT_TRUE(holds(two, expected_two)) << two << " of " << expected_two << ", stop " << stop;
    }
  }
}

TEST(WindowKernels, StackLeavesOnEverySet) {
  std::mt19937_64 random(2);
  const kernels::WindowKernelList sets = kernels::runnableWindowKernels();
  for (int count = 1; count <= 8; ++count) {
    std::uint64_t words[8][8];
    const std::uint64_t* leaves[8];
    for (int n = 0; n < 8; ++n) {
      for (std::uint64_t& word : words[n]) word = random();
      leaves[n] = below(random, 4) == 0 ? nullptr : words[n];
    }
    for (int n = 0; n < sets.count; ++n) {
      constexpr std::size_t kStride = 24;
      std::vector<std::uint64_t> columns(8 * kStride, ~std::uint64_t{0});
      sets.kernels[n]->stack(leaves, count, columns.data(), kStride);
      for (std::size_t x = 0; x < 8; ++x) {
        for (std::size_t y = 0; y < kStride; ++y) {
          const std::uint64_t column = columns[x * kStride + y];
          if (y >= 8) {
            ASSERT_EQ(column, ~std::uint64_t{0}) << "written outside";
            continue;
          }
          for (std::size_t z = 0; z < 64; ++z) {
            const std::uint64_t* leaf = z / 8 < static_cast<std::size_t>(count) ? leaves[z / 8] : nullptr;
            const bool expected = leaf != nullptr && (leaf[x] >> (8 * y + z % 8) & 1u) != 0;
            ASSERT_EQ((column >> z & 1u) != 0, expected) << sets.kernels[n]->name << " " << x << " " << y << " " << z;
          }
        }
      }
    }
  }
}

/// A map, a tool and a corridor at random.
struct WindowWorld {
  OccupancyFixture map{0.5};
  ToolFixture tool;
  ApproachFixture approach{12, {0.7, 1.6, 3.1}};
  std::array<std::int32_t, 3> centre;

  /// @param height  of the tool, voxels
  WindowWorld(std::mt19937_64& random, int height) {
    centre = {below(random, 200) - 100, below(random, 200) - 100, below(random, 200) - 100};
    for (int d = 0; d < 12; ++d) {
      for (int n = below(random, 40); n > 0; --n) {
        const std::uint64_t bits = random() & random() & random();
        const int low = below(random, std::max(1, height - 63)) - height / 2;
        if (bits == 0) continue;
        const int dx = below(random, 25) - 12, dy = below(random, 25) - 12;
        const auto place = [&](const kernels::VoxelColumn& c) { return c.dx == dx && c.dy == dy; };
        const auto own = tool.columns.begin() + tool.begin.back();
        if (std::none_of(own, tool.columns.end(), place)) tool.columns.push_back(column(dx, dy, low, bits));
      }
      tool.endDirection();
    }
    const int up = height / 2 + 70;
    for (int n = 0; n < 6000; ++n) {
      const Voxel voxel = {centre[0] + below(random, 60) - 30, centre[1] + below(random, 60) - 30,
                           centre[2] + below(random, 2 * up) - up};
      below(random, 2) == 0 ? map.collide(voxel) : map.freeArm(voxel);
    }
    for (int n = 0; n < 6000; ++n) {
      map.freeArm(
          {centre[0] + below(random, 30) - 15, centre[1] + below(random, 30) - 15, centre[2] + below(random, 10) - 5});
    }
  }
  [[nodiscard]] int collisions(int d, const Voxel& point) const {
    int count = 0;
    for (const Voxel& v : tool.voxels(d)) {
      count += map.collides({point[0] + v[0], point[1] + v[1], point[2] + v[2]}) ? 1 : 0;
    }
    return count;
  }
};

TEST(MapWindow, CountsTheToolVoxelsThatCollide) {
  std::mt19937_64 random(3);
  const kernels::WindowKernelList sets = kernels::runnableWindowKernels();
  int several_words = 0;
  std::int64_t all = 0;
  for (int round = 0; round < 24; ++round) {
    WindowWorld world(random, round % 3 == 0 ? 200 : 64);
    const kernels::OccupancyReader reader = world.map.reader();
    const WindowedTool windowed(world.tool.view(1), world.approach.view, world.map.inverseVoxelSize());
    ASSERT_TRUE(windowed.usable());
    several_words += windowed.shape().words() > 1 ? 1 : 0;
    MapWindow window(windowed, *sets.kernels[round % sets.count]);
    for (int group = 0; group < 4; ++group) {
      const auto near = [&](int axis) { return world.centre[static_cast<std::size_t>(axis)] + below(random, 20) - 10; };
      const std::int32_t edge[3] = {8 << windowed.shape().xy_log2, 8 << windowed.shape().xy_log2,
                                    8 << windowed.shape().z_log2};
      std::array<std::int32_t, 3> low;
      for (int axis = 0; axis < 3; ++axis) low[static_cast<std::size_t>(axis)] = near(axis) & -edge[axis];
      const auto inGroup = [&] {
        return Voxel{low[0] + below(random, edge[0]), low[1] + below(random, edge[1]), low[2] + below(random, edge[2])};
      };
      const Voxel any = inGroup();
      window.moveTo(reader, kernels::Coord(any[0] >> 3, any[1] >> 3, any[2] >> 3));
      for (int n = 0; n < 60; ++n) {
        const Voxel point = inGroup();
        const int d = below(random, 12), expected = world.collisions(d, point);
        const int stop = below(random, 2) == 0 ? below(random, expected + 3) : 1 << 30;
        const float inverse = world.map.inverseVoxelSize();
        const float p[3] = {static_cast<float>(point[0]) / inverse, static_cast<float>(point[1]) / inverse,
                            static_cast<float>(point[2]) / inverse};
        window.standAt(p, kernels::Coord(point[0], point[1], point[2]), inverse);
        const int counted = window.countVoxels(d, stop);
        if (expected <= stop) {
          ASSERT_EQ(counted, expected) << round << " " << n;
        } else {
          ASSERT_GT(counted, stop) << round << " " << n;
          ASSERT_LE(counted, expected) << round << " " << n;
        }
        all += expected;
      }
    }
  }
  EXPECT_GT(several_words, 0);
  EXPECT_GT(all, 1000) << "nothing collided";
}

TEST(MapWindow, TestsCorridorsAndSamplesOneVoxelAtATime) {
  std::mt19937_64 random(4);
  int free = 0, hits = 0, stayed = 0;
  std::array<int, 2> blocked = {};
  for (int round = 0; round < 12; ++round) {
    WindowWorld world(random, 64);
    const kernels::OccupancyReader reader = world.map.reader();
    std::vector<float> samples;
    std::vector<std::uint32_t> begin = {0};
    for (int d = 0; d < 12; ++d) {
      for (int n = 0; n < 3 * 20; ++n) samples.push_back(static_cast<float>(between(random, -4, 4)));
      begin.push_back(static_cast<std::uint32_t>(samples.size() / 3));
    }
    kernels::ToolKernelView tool;
    tool.use_samples = true;
    tool.samples = samples.data();
    tool.sample_begin = begin.data();
    const float inverse = world.map.inverseVoxelSize();
    const WindowedTool windowed(tool, world.approach.view, inverse);
    MapWindow window(windowed);
    const kernels::ApproachView& approach = world.approach.view;
    std::array<std::int32_t, 3> last_group = {};
    for (int n = 0; n < 500; ++n) {
      float p[3];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        p[axis] = static_cast<float>(0.5 * world.centre[axis] + between(random, -3, 3));
      }
      const auto voxelAt = [&](const float* offset) {
        Voxel voxel;
        for (std::size_t a = 0; a < 3; ++a) {
          voxel[a] = static_cast<std::int32_t>(std::floor((p[a] + offset[a]) * inverse + 0.5f));
        }
        return voxel;
      };
      const float here[3] = {0, 0, 0};
      const Voxel own = voxelAt(here);
      // Points of the same group follow each other without a move.
      const std::array<std::int32_t, 3> group = {own[0] >> (3 + windowed.shape().xy_log2),
                                                 own[1] >> (3 + windowed.shape().xy_log2),
                                                 own[2] >> (3 + windowed.shape().z_log2)};
      if (n == 0 || group != last_group) {
        window.moveTo(reader, kernels::Coord(own[0] >> 3, own[1] >> 3, own[2] >> 3));
      } else {
        ++stayed;
      }
      last_group = group;
      window.standAt(p, kernels::Coord(own[0], own[1], own[2]), inverse);
      const int d = below(random, 12);
      const kernels::ArmResult arm = window.testArm(approach, d);
      int passed = 0;
      const float* offset = approach.arm_offsets + 3 * (d * approach.num_arm);
      while (passed < approach.num_arm && world.map.armFree(voxelAt(offset + 3 * passed))) ++passed;
      ASSERT_EQ(arm.passed, passed);
      if (passed == approach.num_arm) {
        ASSERT_EQ(arm.reason, PointReason::None);
        ++free;
      } else {
        const bool collides = world.map.collides(voxelAt(offset + 3 * passed));
        ASSERT_EQ(arm.reason, collides ? PointReason::Arm : PointReason::Unknown);
        ++blocked[collides ? 1 : 0];
      }
      int expected = 0;
      for (std::uint32_t s = begin[static_cast<std::size_t>(d)]; s < begin[static_cast<std::size_t>(d) + 1]; ++s) {
        expected += world.map.collides(voxelAt(samples.data() + 3 * std::size_t{s})) ? 1 : 0;
      }
      ASSERT_EQ(window.countSamples(tool, d, 1 << 30), expected);
      hits += expected;
    }
  }
  EXPECT_GT(free, 10);
  EXPECT_GT(blocked[0], 10);
  EXPECT_GT(blocked[1], 10);
  EXPECT_GT(hits, 100);
  EXPECT_GT(stayed, 100);
}

TEST(WindowedTool, IsNotUsableIfTheWindowWouldBeTooLarge) {
  ToolFixture tool;
  tool.columns = {column(0, 0, 0, 1), column(20000, 0, 0, 1), column(0, 20000, 0, 1)};
  tool.endDirection();
  const ApproachFixture approach(1, {1.0});
  EXPECT_FALSE(WindowedTool(tool.view(1), approach.view, 1.0f).usable());
}

}  // namespace
}  // namespace accessvdb::test
