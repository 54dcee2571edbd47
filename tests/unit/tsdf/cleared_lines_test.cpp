// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What rays clear beyond their bands, and what the platform clears: against the geometry itself, in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <vector>

#include "tsdf/platform_balls.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

using Voxel = std::array<std::int32_t, 3>;
constexpr double kVoxel_m = 0.05, kInfinity = std::numeric_limits<double>::infinity();

struct RandomRays {
  explicit RandomRays(unsigned seed) : random(seed) {}
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
  Eigen::Vector3d direction() {
    if (random() % 8 == 0) {  // along an axis or a diagonal
      const Eigen::Vector3d way(static_cast<int>(random() % 3) - 1, static_cast<int>(random() % 3) - 1, 1);
      return way.normalized();
    }
    return Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1)).normalized();
  }
  std::mt19937 random;
};

TsdfParams paramsOf(double clear_rays_m, double platform_radius_m = 0) {
  TsdfParams params;
  params.voxel_size_m = kVoxel_m;
  params.truncation_distance_m = 4 * kVoxel_m;
  params.clear_rays_m = clear_rays_m;
  params.platform_radius_m = platform_radius_m;
  return params;
}

std::set<Voxel> clearedOf(const PackedMap& map) {
  std::set<Voxel> all;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      if (!leaf->isValueOn(n)) continue;
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      all.insert({ijk.x(), ijk.y(), ijk.z()});
    }
  }
  return all;
}

TEST(ClearedLine, IsOneVoxelOfEachLayerOnTheRay) {
  RandomRays of(1);
  std::size_t voxels = 0;
  for (int n = 0; n < 2000; ++n) {
    const Eigen::Vector3f p =
        (Eigen::Vector3d(of.uniform(-1, 1), of.uniform(-1, 1), of.uniform(-1, 1)) * 500).cast<float>();
    const double range = std::exp(of.uniform(-1, 6));
    const Eigen::Vector3f q = p + (range * of.direction()).cast<float>();
    const ReturnRay ray = makeRay(p.data(), q.data(), kVoxel_m);
    const double begin = of.uniform(0, 20), end = n % 5 == 0 ? kInfinity : of.uniform(0, 3000);
    const kernels::ClearedLine line(ray, static_cast<float>(begin), static_cast<float>(end));
    const Eigen::Vector3d u(ray.to_sensor[0], ray.to_sensor[1], ray.to_sensor[2]);
    const double most = u.cwiseAbs().maxCoeff(), length = std::min(end, static_cast<double>(ray.range)) - begin;
    EXPECT_NEAR(line.count, std::max(0.0, std::floor(length * most)), 1);
    std::int32_t before = line.voxel(0, line.axis);
    for (std::int32_t k = 1; k <= line.count; ++k) {
      for (int a = 0; a < 3; ++a) {
        const double on_ray = ray.offset[a] + (begin + k / most) * u[a];
        ASSERT_NEAR(line.voxel(k, a), on_ray, 0.5 + 1e-3) << n << " " << k << " " << a;
      }
      ASSERT_EQ(std::abs(line.voxel(k, line.axis) - before), 1);
      before = line.voxel(k, line.axis);
      ++voxels;
    }
  }
  EXPECT_GT(voxels, 100000U);
}

/// @param far_m  how far from the returns
std::vector<Eigen::Vector3f> returnsAround(RandomRays& of, const Eigen::Vector3f& q, int count, double far_m) {
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < count; ++n) p.push_back(q + (of.uniform(1, far_m) * of.direction()).cast<float>());
  return p;
}

/// Map by map the union of lines, although leaves that are clear already are passed over.
TEST(ClearedLine, IsClearInTheMapAfterManyScansAndNothingElseIs) {
  for (const double clear_m : {1.0, 3.0, kInfinity}) {
    RandomRays of(7);
    const TsdfParams params = paramsOf(clear_m);
    PackedMap map(params), band_only(paramsOf(0)), later(params);
    ScanIntegrator integrator(map), of_band(band_only), again(later);
    std::set<Voxel> lines;
    std::uint64_t passed = 0, by_bands = 0, passed_again = 0;
    const RegionShape shape(params);
    for (int scan = 0; scan < 6; ++scan) {
      const Eigen::Vector3f q(0.1f * static_cast<float>(scan), 0.2f, 1);
      std::vector<Eigen::Vector3f> p = returnsAround(of, q, 250, 12);
      passed += integrator.integrate(p, {&q, 1}).counts.cleared_updates;
      by_bands += of_band.integrate(p, {&q, 1}).counts.cleared_updates;
      for (const Eigen::Vector3f& one : p) {
        const ReturnRay ray = makeRay(one.data(), q.data(), kVoxel_m);
        const kernels::ClearedLine line(ray, shape.band_end, shape.line_end);
        for (std::int32_t k = 1; k <= line.count; ++k) {
          lines.insert({ray.base_ijk[0] + line.voxel(k, 0), ray.base_ijk[1] + line.voxel(k, 1),
                        ray.base_ijk[2] + line.voxel(k, 2)});
        }
      }
      std::ranges::shuffle(p, of.random);  // no order matters, nor that a scan comes twice
      again.integrate(p, {&q, 1});
      passed_again += again.integrate(p, {&q, 1}).counts.cleared_updates;
    }
    std::set<Voxel> expected = clearedOf(band_only);
    EXPECT_GT(lines.size(), clear_m < 3 ? 5000U : 50000U);
    expected.insert(lines.begin(), lines.end());
    EXPECT_TRUE(clearedOf(map) == expected) << clear_m;
    EXPECT_TRUE(clearedOf(later) == expected) << clear_m;
    EXPECT_GT(passed, by_bands + lines.size() / 2);
    EXPECT_EQ(passed_again, by_bands);  // what is clear already is passed over
  }
}

TEST(PlatformBall, IsFreeUnlessSomethingIsThere) {
  const double radius_m = 0.423;  // no voxel is as far from a sensor below
  const TsdfParams params = paramsOf(0, radius_m);
  PackedMap map(params), without(paramsOf(0));
  map.setCollisionDistance(0.025f);
  ScanIntegrator integrator(map), of_band(without);
  RandomRays of(3);
  const auto integrate = [&](const std::vector<Eigen::Vector3f>& p, const std::vector<Eigen::Vector3f>& q) {
    of_band.integrate(p, q);
    return integrator.integrate(p, q).contradicted_platforms;
  };
  std::vector<Eigen::Vector3f> q = {{0.013f, 0.2f, 1.5f}};
  EXPECT_EQ(integrate(returnsAround(of, q[0], 50, 6), q), 0U);
  std::set<Voxel> expected = clearedOf(without);
  const auto addBall = [&](const Eigen::Vector3f& centre) {
    std::size_t voxels = 0;
    for (int x = -40; x <= 80; ++x) {
      for (int y = -40; y <= 80; ++y) {
        for (int z = 0; z <= 80; ++z) {
          const Eigen::Vector3d at = Eigen::Vector3d(x, y, z) * kVoxel_m;
          if ((at - centre.cast<double>()).norm() > radius_m) continue;
          expected.insert({x, y, z});
          ++voxels;
        }
      }
    }
    EXPECT_NEAR(static_cast<double>(voxels), 4.0 / 3 * M_PI * std::pow(radius_m / kVoxel_m, 3), 200);
  };
  addBall(q[0]);
  EXPECT_TRUE(clearedOf(map) == expected);

  // Of a ray cloud, one for each voxel with a sensor, whatever the order.
  q.clear();
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 40; ++n) {
    q.emplace_back(1.0f + 0.01f * static_cast<float>(n), 0.2f, 1.5f);
    p.push_back(q.back() + Eigen::Vector3f(0, 0, -1.2f));
  }
  std::swap(q[3], q[17]);
  std::swap(p[3], p[17]);
  EXPECT_EQ(integrate(p, q), 0U);
  for (const Voxel& voxel : clearedOf(without)) expected.insert(voxel);
  std::set<Voxel> seen;
  std::ranges::sort(q, {}, [](const Eigen::Vector3f& at) { return at.x(); });
  for (const Eigen::Vector3f& at : q) {
    const ReturnRay ball = ballAround(at.data(), kVoxel_m);
    if (seen.insert({ball.base_ijk[0], ball.base_ijk[1], ball.base_ijk[2]}).second) addBall(at);
  }
  EXPECT_GE(seen.size(), 8U);
  EXPECT_TRUE(clearedOf(map) == expected);

  // A return within it, then what that left in the map, then a place beside it.
  q = {{5, 5, 1.5f}};
  EXPECT_EQ(integrate({{5, 5, 1.1f}, {5, 8, 1.5f}}, q), 1U);
  EXPECT_EQ(integrate({{5, 8, 1.5f}}, {{5, 5.1f, 1.4f}}), 1U);
  for (const Voxel& voxel : clearedOf(without)) expected.insert(voxel);
  EXPECT_TRUE(clearedOf(map) == expected);
  EXPECT_EQ(integrate({{5, 8, 1.5f}}, {{5, 6, 1.5f}}), 0U);
  // Of several sensors, only the one in whose ball it lies, whoever has seen it.
  EXPECT_EQ(
      integrate({{12, 5, 1.5f}, {11.8f, 9, 1.5f}, {15, 9, 1.5f}}, {{10, 5, 1.5f}, {11.8f, 5, 1.5f}, {15, 5, 1.5f}}),
      1U);
  EXPECT_GT(clearedOf(map).size(), expected.size() + 1000);
}

}  // namespace
}  // namespace accessvdb::internal
