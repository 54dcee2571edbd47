// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts of cells against counting voxel by voxel, also on the negative side of the map.
#include "hostdev/cell_counts.h"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb {
namespace {

using test::below;
using LeafWords = std::array<std::uint64_t, 8>;

/// Byte 4 (x / 4) + 2 (y / 4) + z / 4 counts the cell of (x, y, z).
std::array<int, 8> countedBitByBit(const LeafWords& words) {
  std::array<int, 8> counts = {};
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      for (int z = 0; z < 8; ++z) {
        if ((words[static_cast<std::size_t>(x)] >> (8 * y + z) & 1) == 0) continue;
        ++counts[static_cast<std::size_t>(4 * (x / 4) + 2 * (y / 4) + z / 4)];
      }
    }
  }
  return counts;
}

void expectCounted(const LeafWords& words) {
  const std::uint64_t counts = kernels::countCells(words.data());
  const std::array<int, 8> expected = countedBitByBit(words);
  for (std::size_t cell = 0; cell < 8; ++cell) {
    ASSERT_EQ(static_cast<int>(counts >> (8 * cell) & 0xff), expected[cell]) << "cell " << cell;
  }
}

std::int32_t floorDivided(std::int32_t value, std::int32_t by) {
  return value >= 0 ? value / by : -((-value + by - 1) / by);
}

/// A random map without end: a third of its cells full, a third empty, the others half full.
bool mapCollides(std::int32_t x, std::int32_t y, std::int32_t z) {
  const auto mixed = [](std::int32_t a, std::int32_t b, std::int32_t c) {
    std::uint64_t h = static_cast<std::uint32_t>(a) * 0x9e3779b97f4a7c15u;
    h = (h ^ h >> 29 ^ static_cast<std::uint32_t>(b)) * 0xbf58476d1ce4e5b9u;
    h = (h ^ h >> 32 ^ static_cast<std::uint32_t>(c)) * 0x94d049bb133111ebu;
    return h ^ h >> 31;
  };
  const std::uint64_t kind = mixed(floorDivided(x, 4), floorDivided(y, 4), floorDivided(z, 4)) % 3;
  return kind == 0 || (kind == 1 && mixed(x, y, z) % 2 == 0);
}

/// Voxels of a cell, given in cells, that collide.
template <class Collides>
int collidingIn(std::int32_t cx, std::int32_t cy, std::int32_t cz, const Collides& collides) {
  int count = 0;
  for (int i = 0; i < 64; ++i) count += collides(4 * cx + i / 16, 4 * cy + i / 4 % 4, 4 * cz + i % 4) ? 1 : 0;
  return count;
}

/// All that a run asks for, voxel by voxel.
template <class Collides>
int countedByVoxels(const kernels::CellRun& run, const kernels::Coord& point, const Collides& collides) {
  int count = 0;
  for (int i = 0; i < 16; ++i) {
    if ((run.bits >> i & 1) == 0) continue;
    count += collidingIn(floorDivided(point[0], 4) + run.dx, floorDivided(point[1], 4) + run.dy,
                         floorDivided(point[2], 4) + run.dz + i, collides);
  }
  return count;
}

kernels::CellRun randomRun(std::mt19937_64& random, int reach) {
  const auto offset = [&] { return static_cast<std::int16_t>(below(random, 2 * reach + 1) - reach); };
  constexpr std::array<std::uint16_t, 5> kSpecial = {0xffff, 0x8000, 0x0001, 0x8001, 0x5555};
  const auto bits = static_cast<std::uint16_t>(random());
  const int n = below(random, 10);
  return {offset(), offset(), offset(), n < 5 ? kSpecial[static_cast<std::size_t>(n)] : bits};
}

/// A point whose voxel has the place `phase` in its cell.
kernels::Coord pointAt(std::mt19937_64& random, int phase, int reach) {
  const auto base = [&] { return 4 * (below(random, 2 * reach) - reach); };
  return {base() + phase / 16, base() + phase / 4 % 4, base() + phase % 4};
}

TEST(CountCells, EqualsCountingOneByOne) {
  LeafWords words;
  for (const std::uint64_t all : {std::uint64_t{0}, ~std::uint64_t{0}}) {
    words.fill(all);
    expectCounted(words);
  }
  for (std::size_t bit = 0; bit < 512; ++bit) {
    words.fill(0);
    words[bit / 64] = std::uint64_t{1} << (bit % 64);
    expectCounted(words);
  }
  std::mt19937_64 random(1);
  for (int trial = 0; trial < 2000; ++trial) {
    for (std::uint64_t& word : words) {
      word = random();
      if (trial % 3 == 1) word &= random() & random();
      if (trial % 3 == 2) word |= random() | random();
    }
    expectCounted(words);
  }
}

TEST(CellInLeaf, IsTheSameForAVoxelAndItsPlaceInTheLeaf) {
  for (std::int32_t x = -17; x <= 17; ++x) {
    for (std::int32_t y = -17; y <= 17; ++y) {
      for (std::int32_t z = -17; z <= 17; ++z) {
        const auto half = [](std::int32_t v) { return (v - 8 * floorDivided(v, 8)) / 4; };
        ASSERT_EQ(kernels::cellInLeaf(x, y, z), 4 * half(x) + 2 * half(y) + half(z)) << x << " " << y << " " << z;
      }
    }
  }
}

TEST(CellPhase, IsThePlaceInTheCellOnBothSidesOfZero) {
  std::mt19937_64 random(2);
  for (int phase = 0; phase < kernels::kCellPhases; ++phase) {
    for (int n = 0; n < 20; ++n) {
      const kernels::Coord point = pointAt(random, phase, 30);
      ASSERT_EQ(kernels::cellPhase(point), phase) << point[0] << " " << point[1] << " " << point[2];
    }
  }
}

TEST(CountRun, EqualsCountingVoxels) {
  std::mt19937_64 random(3);
  for (int phase = 0; phase < kernels::kCellPhases; ++phase) {
    for (int n = 0; n < 30; ++n) {
      const kernels::Coord point = pointAt(random, phase, 40);
      const kernels::CellRun run = randomRun(random, 9);
      int aligned = 0, asked = 0;
      const int count = kernels::countRun(run, point, [&](std::int32_t x, std::int32_t y, std::int32_t z8) {
        ++asked;
        aligned += z8 - 8 * floorDivided(z8, 8) == 0 ? 1 : 0;
        const auto at = [&](std::int32_t z) {
          return collidingIn(floorDivided(x, 4), floorDivided(y, 4), floorDivided(z, 4), mapCollides);
        };
        return static_cast<std::uint32_t>(at(z8) | at(z8 + 4) << 8);
      });
      ASSERT_EQ(count, countedByVoxels(run, point, mapCollides))
          << point[0] << " " << point[1] << " " << point[2] << " bits " << run.bits << " from " << run.dz;
      ASSERT_EQ(aligned, asked);
      ASSERT_LE(asked, 9);  // 16 cells from the upper half of a leaf
    }
  }
}

/// The same on the counts that the mirror keeps.
TEST(CountRun, EqualsCountingVoxelsOfTheMirror) {
  std::mt19937_64 random(4);
  test::OccupancyFixture map;
  constexpr std::int32_t kHalf = 28;
  for (std::int32_t x = -kHalf; x < kHalf; ++x) {
    for (std::int32_t y = -kHalf; y < kHalf; ++y) {
      for (std::int32_t z = -kHalf; z < kHalf; ++z) {
        if (z < 12 && mapCollides(x, y, z)) map.collide({x, y, z});
      }
    }
  }
  const kernels::OccupancyReader reader = map.reader();
  int most = 0;
  for (int n = 0; n < 600; ++n) {
    const kernels::Coord point = pointAt(random, n % kernels::kCellPhases, 5);
    const kernels::CellRun run = randomRun(random, 5);
    const int count = kernels::countRun(run, point, [&](std::int32_t x, std::int32_t y, std::int32_t z8) {
      return reader.cellCounts(kernels::Coord(x, y, z8), kernels::cellInLeaf(x, y, z8));
    });
    ASSERT_EQ(count, countedByVoxels(run, point, [&](std::int32_t x, std::int32_t y, std::int32_t z) {
                return map.collides({x, y, z});
              }));
    most = std::max(most, count);
  }
  EXPECT_GT(most, 300);  // else the map was hardly met
}

}  // namespace
}  // namespace accessvdb
