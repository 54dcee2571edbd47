// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/short_places.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace accessvdb::internal {
namespace {

constexpr std::int32_t kFarthest = 1 << 20;  // voxels lie below it

/// Voxels of a box around a corner, half of them copied from others.
std::vector<Index3> voxelsAround(const Index3& corner, const Index3& size, std::mt19937& random) {
  std::vector<Index3> voxels(500);
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    if (n % 2 != 0) {
      voxels[n] = voxels[random() % n];
      continue;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto along = static_cast<std::int32_t>(random() % static_cast<std::uint32_t>(size[axis]));
      voxels[n][axis] = std::min(corner[axis] + along, kFarthest - 1);
    }
  }
  return voxels;
}

TEST(ShortPlaces, SortVoxelsAsTheirPlacesDo) {
  std::mt19937 random(1);
  for (const Index3& corner : {Index3{0, 0, 0}, Index3{-1, -1, -1}, Index3{-700, 12, -3},
                               Index3{-kFarthest, -kFarthest, -kFarthest}, Index3{kFarthest - 9, 0, kFarthest - 1}}) {
    for (const Index3& size : {Index3{1, 1, 1}, Index3{8, 8, 8}, Index3{9, 1, 2000}, Index3{3000, 700, 1},
                               Index3{2 * kFarthest, 2 * kFarthest, 2 * kFarthest}}) {
      const std::vector<Index3> voxels = voxelsAround(corner, size, random);
      ShortPlaces::Box leaves;
      for (const Index3& voxel : voxels) leaves.add(parentOf(voxel));
      const ShortPlaces places(leaves);
      for (std::size_t n = 1; n < voxels.size(); ++n) {
        const std::uint64_t a = placeOf(voxels[n - 1]), b = placeOf(voxels[n]);
        ASSERT_EQ(places(a) < places(b), a < b);
        ASSERT_EQ(places(a) == places(b), a == b);
        ASSERT_TRUE(places.bits() == 64 || places(b) >> places.bits() == 0);
      }
    }
  }
}

TEST(ShortPlaces, OfOneLeafAreTheBitsOfItsVoxels) {
  ShortPlaces::Box leaf;
  leaf.add({-5, 0, 7});
  const ShortPlaces places(leaf);
  EXPECT_EQ(places.bits(), 9);
  for (const std::size_t bit : {0u, 1u, 511u}) EXPECT_EQ(places(placeOf(childOf({-5, 0, 7}, bit))), bit);
}

TEST(ShortPlaces, AreShortWhereLeavesAreNear) {
  ShortPlaces::Box leaves, others;
  leaves.add({-100, -1, 0});
  others.add({155, 0, 0});  // 256 leaves, two, one
  leaves.add(others);
  EXPECT_EQ(ShortPlaces(leaves).bits(), 8 + 1 + 0 + 9);
}

}  // namespace
}  // namespace accessvdb::internal
