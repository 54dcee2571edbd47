// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which corridors may have become free, against voxel by voxel, also on the negative side of the map.
#include "hostdev/freed_corridors.h"

#include <gtest/gtest.h>

#include <array>
#include <random>
#include <vector>

namespace accessvdb {
namespace {

using kernels::Coord;
using kernels::DirectionMask;
using LeafWords = std::array<std::uint64_t, 8>;

bool isSet(const LeafWords& words, int x, int y, int z) {
  return (words[static_cast<std::size_t>(x)] >> (8 * y + z) & 1) != 0;
}

/// A few voxels, or one in `sparse` of all.
LeafWords randomLeaf(std::mt19937_64& random, int few, int sparse) {
  LeafWords words = {};
  for (int n = 0; n < few; ++n) words[random() % 8] |= std::uint64_t{1} << random() % 64;
  for (int bit = 0; sparse > 0 && bit < 512; ++bit) {
    if (random() % static_cast<unsigned>(sparse) == 0) {
      words[static_cast<std::size_t>(bit / 64)] |= std::uint64_t{1} << bit % 64;
    }
  }
  return words;
}

TEST(ColumnsForArm, HasTheColumnsAndHeightsOfAllVoxels) {
  std::mt19937_64 random(1);
  for (int n = 0; n < 2000; ++n) {
    const LeafWords words = randomLeaf(random, n % 7, n % 5 == 0 ? 1 + n % 64 : 0);
    kernels::ColumnsForArm expected;
    for (int x = 0; x < 8; ++x) {
      for (int y = 0; y < 8; ++y) {
        for (int z = 0; z < 8; ++z) {
          if (!isSet(words, x, y, z)) continue;
          expected.columns |= std::uint64_t{1} << (8 * x + y);
          expected.heights |= 1u << z;
        }
      }
    }
    const kernels::ColumnsForArm freed = kernels::columnsForArm(words.data());
    ASSERT_EQ(freed.columns, expected.columns) << n;
    ASSERT_EQ(freed.heights, expected.heights) << n;
  }
}

/// A table of random directions for offsets of up to 20 voxels.
class Table {
 public:
  explicit Table(std::mt19937_64& random) : directions_(41 * 41) {
    for (DirectionMask& mask : directions_) {
      mask = {};
      for (int n = 0; n < 3; ++n) mask.set(static_cast<int>(random() % 256));
    }
  }
  [[nodiscard]] kernels::CorridorView view() const { return {directions_.data(), 20}; }
  [[nodiscard]] DirectionMask at(int dx, int dy) const {
    if (dx < -20 || dx > 20 || dy < -20 || dy > 20) return {};
    return directions_[static_cast<std::size_t>((dx + 20) * 41 + dy + 20)];
  }

 private:
  std::vector<DirectionMask> directions_;  ///< [x][y]
};

/// Directions of all voxels of a leaf at the height of the point, one by one.
DirectionMask oneByOne(const Table& table, const LeafWords& words, const std::array<int, 3>& leaf, const Coord& point) {
  DirectionMask directions = {};
  for (int x = 0; x < 8; ++x) {
    for (int y = 0; y < 8; ++y) {
      for (int z = 0; z < 8; ++z) {
        if (!isSet(words, x, y, z) || 8 * leaf[2] + z != point[2]) continue;
        directions = directions | table.at(8 * leaf[0] + x - point[0], 8 * leaf[1] + y - point[1]);
      }
    }
  }
  return directions;
}

DirectionMask byRule(const Table& table, const LeafWords& words, const std::array<int, 3>& leaf, const Coord& point) {
  const kernels::ColumnsForArm freed = kernels::columnsForArm(words.data());
  DirectionMask directions = {};
  if (point[2] >> 3 == leaf[2] && (freed.heights >> (point[2] & 7) & 1u) != 0) {
    kernels::addFreedCorridors(table.view(), {freed.columns, leaf[0], leaf[1]}, point, directions);
  }
  return directions;
}

bool passes(const Table& table, const LeafWords& words, const std::array<int, 3>& leaf, const Coord& point,
            int direction) {
  const kernels::ColumnsForArm blocked = kernels::columnsForArm(words.data());
  return point[2] >> 3 == leaf[2] && (blocked.heights >> (point[2] & 7) & 1u) != 0 &&
         kernels::corridorMayPass(table.view(), {blocked.columns, leaf[0], leaf[1]}, point, direction);
}

/// None is missing; and none is too many if all voxels are at one height.
TEST(FreedCorridors, AreThoseOfEachVoxel) {
  std::mt19937_64 random(2);
  const Table table(random);
  int concerned = 0, unconcerned = 0;
  for (int n = 0; n < 5000; ++n) {
    const auto near = [&](int reach) {
      return static_cast<int>(random() % (2u * static_cast<unsigned>(reach))) - reach;
    };
    const std::array<int, 3> leaf = {near(2), near(2), near(1)};
    const Coord point(near(16), near(16), near(8));
    LeafWords words = randomLeaf(random, 1 + n % 6, 0);
    const DirectionMask all = oneByOne(table, words, leaf, point);
    EXPECT_FALSE(kernels::any(kernels::without(all, byRule(table, words, leaf, point)))) << n;
    const int z = n % 8;
    for (std::uint64_t& word : words) word &= 0x0101010101010101ull << z;
    const DirectionMask expected = oneByOne(table, words, leaf, point);
    EXPECT_TRUE(byRule(table, words, leaf, point) == expected) << n;
    for (int d = 0; d < 256; ++d) ASSERT_EQ(passes(table, words, leaf, point, d), expected.test(d)) << n;
    ++(kernels::any(expected) ? concerned : unconcerned);
  }
  EXPECT_GT(concerned, 50);
  EXPECT_GT(unconcerned, 50);
}

}  // namespace
}  // namespace accessvdb
