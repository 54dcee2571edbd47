// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Oracle: each leaf that a return may reach, by itself.
#include "launch/scan_extent.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <random>
#include <vector>

namespace accessvdb::kernels {
namespace {

using LeafIjk = std::array<std::int32_t, 3>;

double uniform(std::mt19937& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random()) / static_cast<double>(std::mt19937::max());
}

RegionConstants randomRegion(std::mt19937& random) {
  RegionConstants region = {};
  region.full_cube = random() % 4 == 0;
  region.tau = static_cast<float>(uniform(random, 2.5, 40));
  region.cone_cos = static_cast<float>(uniform(random, 0.6, 0.99));
  region.cone_cos_squared = region.cone_cos * region.cone_cos;
  region.cone_sin_squared = 1 - region.cone_cos_squared;
  region.band_begin = static_cast<float>(uniform(random, 0.2, 1.2)) * region.tau;
  region.band_end = static_cast<float>(uniform(random, 1.3, 6)) * region.tau;
  region.band_radius = random() % 4 == 0 ? 0 : static_cast<float>(uniform(random, 0.3, 6));
  region.line_end = random() % 3 == 0 ? static_cast<float>(uniform(random, 1, 2000)) + region.band_end : 0;
  region.ball_radius = random() % 3 == 0 ? static_cast<float>(uniform(random, 1, 60)) : 0;
  return region;
}

/// Ends beside a corner of upper nodes.
ReturnRay randomRay(const LeafIjk& corner, std::mt19937& random) {
  ReturnRay ray = {};
  const double z = uniform(random, -1, 1), angle = uniform(random, 0, 6.3), flat = std::sqrt(1 - z * z);
  const std::array<double, 3> u = {flat * std::cos(angle), flat * std::sin(angle), z};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    ray.base_ijk[axis] = corner[axis] + static_cast<std::int32_t>(random() % 61) - 30;
    ray.offset[axis] = static_cast<float>(uniform(random, -0.5, 0.5));
    ray.to_sensor[axis] = static_cast<float>(u[axis]);
  }
  ray.range = static_cast<float>(uniform(random, 5, 1500));
  return ray;
}

/// @param visit  (leaf), once for each pair
template <typename Visit>
void forEachPair(const RegionConstants& region, const std::vector<ReturnRay>& rays, std::uint32_t balls,
                 const Visit& visit) {
  const auto take = [&](const std::int32_t* leaf) { visit(LeafIjk{leaf[0], leaf[1], leaf[2]}); };
  for (std::size_t n = 0; n < rays.size(); ++n) {
    if (n >= rays.size() - balls) {
      forEachLeafAround(rays[n], region.ball_radius, take);
      continue;
    }
    forEachLeafOfReturn(region, RegionSlices(region, rays[n]), rays[n],
                        [&](const std::int32_t* leaf, std::uint32_t) { take(leaf); });
    if (region.hasLines()) {
      forEachLeafOfLine(region, rays[n], [&](const std::int32_t* leaf, const std::uint64_t*) { take(leaf); });
    }
  }
}

TEST(ScanExtent, HoldsEveryLeafThatAScanMayReach) {
  std::mt19937 random(7);
  std::uint64_t pairs = 0, several = 0;
  for (int scan = 0; scan < 400; ++scan) {
    const RegionConstants region = randomRegion(random);
    LeafIjk corner;
    for (std::int32_t& x : corner) x = 4096 * (static_cast<std::int32_t>(random() % 481) - 240);
    std::vector<ReturnRay> rays(1 + random() % 8);
    for (ReturnRay& ray : rays) ray = randomRay(corner, random);
    const auto balls = region.ball_radius > 0 ? static_cast<std::uint32_t>(random() % (rays.size() + 1)) : 0;
    const LeafKeys keys = leafKeysFor(region, rays, balls);
    std::map<std::uint64_t, LeafIjk> leaves;
    std::uint64_t of_scan = 0;
    forEachPair(region, rays, balls, [&](const LeafIjk& leaf) {
      ++of_scan;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_GE(leaf[axis] >> 9, keys.low[axis]) << scan;
        ASSERT_LT((leaf[axis] >> 9) - keys.low[axis], static_cast<std::int64_t>(keys.size[axis])) << scan;
      }
      const std::uint64_t key = leafKeyOf(keys, leaf.data());
      ASSERT_EQ(leaves.try_emplace(key, leaf).first->second, leaf);
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(originOf(keys, key)[axis], 8 * leaf[static_cast<std::size_t>(axis)]);
      }
    });
    ASSERT_LE(static_cast<double>(of_scan), extentOf(region, rays, balls).pairs) << scan;
    pairs += of_scan;
    several += std::uint64_t{keys.size[0]} * keys.size[1] * keys.size[2] > 1 ? 1 : 0;
  }
  EXPECT_GT(pairs, 10'000u);
  EXPECT_GT(several, 300u);
}

/// Nodes by nodes, and a node's leaves in the order of its table.
TEST(LeafKeysOfAScan, PutLeavesOfANodeBehindEachOther) {
  LeafKeys keys;
  for (std::size_t axis = 0; axis < 3; ++axis) keys.low[axis] = -2, keys.size[axis] = 3;
  std::mt19937 random(3);
  const auto nodeOf = [](const LeafIjk& leaf, int shift) {
    return LeafIjk{leaf[0] >> shift, leaf[1] >> shift, leaf[2] >> shift};
  };
  for (int n = 0; n < 5000; ++n) {
    LeafIjk a, b;
    for (std::int32_t& x : a) x = static_cast<std::int32_t>(random() % 1536) - 1024;
    b = a;
    for (std::int32_t& x : b) {  // mostly of the same node
      const auto far = static_cast<std::int32_t>(random() % 1536) - 1024;
      x = random() % 3 == 0 ? far : (x & ~15) + static_cast<std::int32_t>(random() % 16);
    }
    const std::uint64_t of_a = leafKeyOf(keys, a.data()), of_b = leafKeyOf(keys, b.data());
    ASSERT_EQ(of_a == of_b, a == b);
    ASSERT_EQ(of_a >> LeafKeys::kLowerShift == of_b >> LeafKeys::kLowerShift, nodeOf(a, 4) == nodeOf(b, 4));
    ASSERT_EQ(of_a >> LeafKeys::kUpperShift == of_b >> LeafKeys::kUpperShift, nodeOf(a, 9) == nodeOf(b, 9));
    ASSERT_EQ(of_a & 4095, OccupancyLower::CoordToOffset(nanovdb::Coord(8 * a[0], 8 * a[1], 8 * a[2])));
  }
}

void expectTooLarge(const RegionConstants& region, const std::vector<ReturnRay>& rays) {
  try {
    static_cast<void>(leafKeysFor(region, rays, 0));
    ADD_FAILURE() << "not refused";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "device.scan_extent");
  }
}

TEST(ScanExtent, RefusesWhatHasNoKeys) {
  std::mt19937 random(1);
  RegionConstants region = randomRegion(random);
  region.line_end = region.ball_radius = 0;
  const std::vector<ReturnRay> one = {randomRay({0, 0, 0}, random)};
  EXPECT_NO_THROW(static_cast<void>(leafKeysFor(region, one, 0)));
  EXPECT_NO_THROW(static_cast<void>(leafKeysFor(region, {}, 0)));
  constexpr std::int32_t kFar = 2'000'000'000;
  expectTooLarge(region, {randomRay({-kFar, -kFar, -kFar}, random), randomRay({kFar, kFar, kFar}, random)});
  region.tau = 4000;  // a thousand million leaves around one return
  EXPECT_NO_THROW(static_cast<void>(leafKeysFor(region, one, 0)));
  expectTooLarge(region, std::vector<ReturnRay>(3, one.front()));
}

}  // namespace
}  // namespace accessvdb::kernels
