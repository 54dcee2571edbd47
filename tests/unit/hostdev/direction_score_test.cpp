// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "hostdev/direction_score.h"

#include <gtest/gtest.h>

#include <limits>

#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

TEST(VoxelIndex, HalvesGoUpOnBothSidesOfZero) {
  EXPECT_EQ(kernels::voxelIndex(0.0f, 1.0f), 0);
  EXPECT_EQ(kernels::voxelIndex(0.5f, 1.0f), 1);
  EXPECT_EQ(kernels::voxelIndex(std::nextafter(0.5f, 0.0f) * 0.999f, 1.0f), 0);
  EXPECT_EQ(kernels::voxelIndex(-0.5f, 1.0f), 0);
  EXPECT_EQ(kernels::voxelIndex(-0.500001f, 1.0f), -1);
  EXPECT_EQ(kernels::voxelIndex(-1.5f, 1.0f), -1);
  EXPECT_EQ(kernels::voxelIndex(-7.0f, 1.0f), -7);
  EXPECT_EQ(kernels::voxelIndex(-0.375f, 4.0f), -1);
  EXPECT_EQ(kernels::voxelIndex(0.375f, 4.0f), 2);
  EXPECT_EQ(kernels::voxelIndex(-0.625f, 4.0f), -2);
}

/// Voxel i is centred at i v: every position well inside a cell has its index, at every size.
TEST(VoxelIndex, CellsAreCentred) {
  for (const double v : {0.0005, 0.01, 0.03, 0.0625, 10.0}) {
    const auto inverse = static_cast<float>(1 / v);
    for (const int i : {-1000000, -4097, -9, -8, -1, 0, 1, 7, 8, 511, 4096, 999999}) {
      for (const double offset : {-0.4, 0.0, 0.4}) {
        ASSERT_EQ(kernels::voxelIndex(static_cast<float>((i + offset) * v), inverse), i) << v << " " << offset;
      }
    }
  }
}

TEST(BitCount, EqualsCountingOneByOne) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 1000; ++n) {
    const auto word = static_cast<std::uint32_t>(random());
    int count = 0;
    for (int bit = 0; bit < 32; ++bit) count += static_cast<int>(word >> bit & 1);
    ASSERT_EQ(kernels::bitCount(word), count);
  }
  EXPECT_EQ(kernels::bitCount(0), 0);
  EXPECT_EQ(kernels::bitCount(~0u), 32);
}

int naiveCount(const OccupancyFixture& map, const std::vector<Voxel>& tool, const Voxel& at) {
  int count = 0;
  for (const Voxel& offset : tool) {
    count += map.collides({at[0] + offset[0], at[1] + offset[1], at[2] + offset[2]}) ? 1 : 0;
  }
  return count;
}

TEST(CountVoxelCollisions, EqualsALoopOverVoxelsAndStopsInTime) {
  std::mt19937_64 random(7);
  OccupancyFixture map;
  for (int n = 0; n < 60000; ++n)
    map.collide({below(random, 60) - 40, below(random, 60) - 20, below(random, 160) - 90});
  const auto reader = map.reader();
  std::uint64_t counted = 0, stopped = 0;
  for (int n = 0; n < 4000; ++n) {
    ToolFixture tool;
    tool.columns.push_back(column(0, 0, 0, ~std::uint64_t{0}));  // belongs to another direction: must not be counted
    tool.endDirection();
    const int columns = below(random, 12);
    for (int c = 0; c < columns; ++c) {
      const std::uint64_t bits = c % 3 == 0   ? ~std::uint64_t{0}
                                 : c % 3 == 1 ? std::uint64_t{1} << below(random, 64)
                                              : random() & random();
      tool.columns.push_back(column(below(random, 30) - 15, below(random, 30) - 15, below(random, 90) - 60, bits));
    }
    tool.endDirection();
    tool.columns.push_back(column(0, 0, 0, ~std::uint64_t{0}));
    tool.endDirection();
    const Voxel at = {below(random, 60) - 40, below(random, 60) - 20, below(random, 100) - 70};
    const int expected = naiveCount(map, tool.voxels(1), at);
    const nanovdb::Coord ijk(at[0], at[1], at[2]);
    ASSERT_EQ(kernels::countVoxelCollisions(reader, tool.view(1), 1, ijk, 1 << 30), expected);
    const int stop_above = below(random, 40);
    const int bounded = kernels::countVoxelCollisions(reader, tool.view(1), 1, ijk, stop_above);
    if (expected <= stop_above) {
      ASSERT_EQ(bounded, expected);
    } else {
      ASSERT_GT(bounded, stop_above);
      ASSERT_LE(bounded, expected);
      stopped += bounded < expected ? 1 : 0;
    }
    counted += static_cast<std::uint64_t>(expected);
  }
  EXPECT_GT(counted, 20000u);
  EXPECT_GT(stopped, 500u);  // otherwise it would never stop early
}

/// Each start within a leaf and each single bit, one voxel in the map at a time: every shift of the row logic.
TEST(CountVoxelCollisions, EveryAlignmentOfEveryBit) {
  OccupancyFixture map;
  for (int z = -72; z < 80; ++z) {
    if (z % 3 == 0) map.collide({0, 0, z});
  }
  const auto reader = map.reader();
  ToolFixture tool;
  tool.columns.push_back(column(0, 0, 0, 0));
  tool.endDirection();
  for (int start = -8; start < 8; ++start) {
    for (int bit = 0; bit < 64; ++bit) {
      tool.columns[0].bits = std::uint64_t{1} << bit;
      const int expected = (start + bit) % 3 == 0 ? 1 : 0;
      ASSERT_EQ(kernels::countVoxelCollisions(reader, tool.view(1), 0, nanovdb::Coord(0, 0, start), 100), expected);
    }
    tool.columns[0].bits = ~std::uint64_t{0};
    ASSERT_EQ(kernels::countVoxelCollisions(reader, tool.view(1), 0, nanovdb::Coord(0, 0, start), 100),
              naiveCount(map, tool.voxels(0), {0, 0, start}));
  }
}

TEST(CountSampleCollisions, EqualsALoopAndStops) {
  std::mt19937_64 random(9);
  OccupancyFixture map(0.1);
  for (int n = 0; n < 4000; ++n) map.collide({below(random, 20) - 10, below(random, 20) - 10, below(random, 20) - 10});
  const auto reader = map.reader();
  std::vector<float> samples;
  for (int n = 0; n < 300; ++n) samples.push_back(static_cast<float>(between(random, -0.5, 0.5)));
  const std::uint32_t begin[3] = {0, 30, 100};
  kernels::ToolKernelView tool;
  tool.samples = samples.data();
  tool.sample_begin = begin;
  tool.use_samples = true;
  for (int n = 0; n < 500; ++n) {
    const float p[3] = {static_cast<float>(between(random, -0.5, 0.5)), static_cast<float>(between(random, -0.5, 0.5)),
                        static_cast<float>(between(random, -0.5, 0.5))};
    int expected = 0;
    for (std::size_t s = 30; s < 100; ++s) {
      const auto ijk = kernels::voxelOf(p[0] + samples[3 * s], p[1] + samples[3 * s + 1], p[2] + samples[3 * s + 2],
                                        map.inverseVoxelSize());
      expected += map.collides({ijk[0], ijk[1], ijk[2]}) ? 1 : 0;
    }
    ASSERT_EQ(kernels::countSampleCollisions(reader, tool, 1, p, map.inverseVoxelSize(), 1000), expected);
    const int bounded = kernels::countSampleCollisions(reader, tool, 1, p, map.inverseVoxelSize(), 5);
    ASSERT_EQ(bounded, std::min(expected, 6));
  }
}

TEST(TestArm, FirstBlockedSampleAndWhatBlocksIt) {
  const ApproachFixture approach(4, {2.0, 4.0, 6.0});
  OccupancyFixture map;
  map.freeArm({-10, -10, 0}, {10, 10, 0});
  const float p[3] = {0.2f, -0.3f, 0.1f};
  const auto test = [&](int d) { return kernels::testArm(map.reader(), approach.view, d, p, map.inverseVoxelSize()); };
  EXPECT_EQ(test(0).passed, 3);
  EXPECT_EQ(test(0).reason, PointReason::None);
  map.blockArm({0, 4, 0});  // d = 1 points along +y: never observed
  EXPECT_EQ(test(1).passed, 1);
  EXPECT_EQ(test(1).reason, PointReason::Unknown);
  map.blockArm({-6, 0, 0});  // d = 2 along -x: an obstacle
  map.collide({-6, 0, 0});
  EXPECT_EQ(test(2).passed, 2);
  EXPECT_EQ(test(2).reason, PointReason::Arm);
  map.blockArm({0, -2, 0});  // d = 3: the nearest blocked sample decides
  map.blockArm({0, -4, 0});
  map.collide({0, -4, 0});
  EXPECT_EQ(test(3).passed, 0);
  EXPECT_EQ(test(3).reason, PointReason::Unknown);
  EXPECT_EQ(test(0).reason, PointReason::None);
  map.collide({1, 0, 0});  // between samples: the corridor is sampled, not swept
  EXPECT_EQ(test(0).reason, PointReason::None);
}

/// Cleared by a ray and later observed as surface: armFree decides; a collision there does not matter.
TEST(TestArm, OnlyTheArmBitDecides) {
  const ApproachFixture approach(4, {2.0});
  OccupancyFixture map;
  map.freeArm({2, 0, 0});
  map.collide({2, 0, 0});
  const float p[3] = {0, 0, 0};
  EXPECT_EQ(kernels::testArm(map.reader(), approach.view, 0, p, 1.0f).reason, PointReason::None);
}

}  // namespace
}  // namespace accessvdb::test
