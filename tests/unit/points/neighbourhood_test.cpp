// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Neighbours against brute force, compared by the results: reach, normal, joined views.
#include "points/neighbourhood.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

#include "hostdev/surface_normal.h"
#include "support/normal_grid.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

/// Steps by the text (docs/DESIGN.md, "Steps of means and normals").
struct Steps {
  bool means;       ///< positions are whole steps; else metres
  double per_unit;  ///< of positions
  double radius;    ///< [steps]
  int normal;
};

Steps stepsOf(const FieldParams& params) {
  const double v = params.tsdf.voxel_size_m, radius_m = std::max(10 * v, 0.1), noise = params.tsdf.range_noise_m / v;
  if (params.scoring.mean_positions) {
    const double per_voxel = noise >= 1 ? 4 : noise >= 0.5 ? 8 : noise >= 0.25 ? 16 : 32;
    const int normal = noise >= 2 ? 16 : noise >= 1 ? 24 : noise >= 0.5 ? 32 : noise >= 0.25 ? 48 : 64;
    return {true, 1, std::round(radius_m / v * per_voxel), normal};
  }
  double per_metre = 1;  // the largest power of two that makes at most 2^20 steps of a radius
  while (per_metre * radius_m <= 0x1p20) per_metre *= 2;
  per_metre /= 2;
  return {false, per_metre, std::floor(radius_m * per_metre), 0};
}

/// Offset of another point, in whole steps.
Eigen::Vector3d offsetInSteps(const PointStore& points, std::uint32_t from, std::uint32_t to, const Steps& steps) {
  const Eigen::Vector3d offset = points.pca_N(to).cast<double>() - points.pca_N(from).cast<double>();
  if (steps.means) return offset;
  return (offset * steps.per_unit + Eigen::Vector3d::Constant(0.5)).array().floor();
}

/// The k nearest within the radius by (squared distance in steps, id), by exhaustive search.
std::vector<std::uint32_t> nearest(const PointStore& points, std::uint32_t id, std::size_t k, const Steps& steps) {
  std::vector<std::pair<double, std::uint32_t>> found;
  for (std::uint32_t other = 0; other < points.size(); ++other) {
    const double squared = offsetInSteps(points, id, other, steps).squaredNorm();  // below 2^53: exact
    if (squared <= steps.radius * steps.radius) found.emplace_back(squared, other);
  }
  std::sort(found.begin(), found.end());
  if (found.size() > k) found.resize(k);
  std::vector<std::uint32_t> ids;
  for (const auto& [squared, other] : found) ids.push_back(other);
  return ids;
}

struct Counts {
  std::size_t full = 0, partial = 0, without_normal = 0, rounded = 0;
};

Counts expectEqualToBruteForce(const PointStore& points, const FieldParams& params, std::uint32_t every) {
  const NeighbourhoodSearch search(points, params);
  const auto k = static_cast<std::size_t>(params.scoring.neighbours);
  const Steps steps = stepsOf(params);
  const double radius_N = steps.radius / steps.per_unit;
  std::vector<std::uint32_t> ids(points.size());
  std::iota(ids.begin(), ids.end(), 0u);
  std::shuffle(ids.begin(), ids.end(), std::mt19937_64(1));
  std::vector<Neighbourhood> found(ids.size());
  search.compute(ids, found);
  Counts counts;
  for (std::size_t n = 0; n < ids.size(); n += every) {
    const std::vector<std::uint32_t> near = nearest(points, ids[n], k, steps);
    const Eigen::Vector3d centre = points.pca_N(ids[n]).cast<double>();
    DirectionMask seen = points.seen(ids[n]);
    for (std::size_t m = 0; m < std::min<std::size_t>(near.size(), 10); ++m) seen = seen | points.seen(near[m]);
    EXPECT_TRUE(found[n].seen == (params.scoring.join_neighbour_views ? seen : points.seen(ids[n]))) << ids[n];
    if (near.size() < k) {
      EXPECT_GE(found[n].reach_N, static_cast<float>(radius_N));
      EXPECT_LT(found[n].reach_N, 1.00001 * radius_N);
      ++counts.partial;
    } else {
      const double farthest = (points.pca_N(near.back()).cast<double>() - centre).norm();
      EXPECT_GE(found[n].reach_N, static_cast<float>(farthest)) << ids[n];
      EXPECT_LT(found[n].reach_N, farthest + 1e-5 * radius_N) << ids[n];
      ++counts.full;
    }
    if (near.size() < 3) {
      EXPECT_TRUE(found[n].normal_L.isZero());
      ++counts.without_normal;
      continue;
    }
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const std::uint32_t id : near) mean += offsetInSteps(points, ids[n], id, steps);
    mean /= static_cast<double>(near.size());
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    for (const std::uint32_t id : near) {
      const Eigen::Vector3d e = offsetInSteps(points, ids[n], id, steps) - mean;
      m += e * e.transpose();
    }
    // The solver has its own test; here it shows whether the same neighbours were used.
    Eigen::Vector3f normal;
    kernels::smallestEigenvector({m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)}, normal.data());
    const Eigen::Vector3d to_sensor = points.meanSensor_L(ids[n]) - points.first_L(ids[n]).cast<double>();
    Eigen::Vector3d expected = normal.cast<double>();
    if (expected.dot(to_sensor) < 0) expected = -expected;
    if (steps.normal > 0) {
      const auto point = test::gridPoint(expected, steps.normal, 1e-4);
      if (!point) continue;
      expected = point->cast<double>().normalized();
      ++counts.rounded;
    }
    EXPECT_LT((found[n].normal_L.cast<double>() - expected).norm(), 1e-6) << ids[n];
    if (testing::Test::HasFailure()) break;
  }
  return counts;
}

PointStore storeOf(const FieldParams& params, const std::vector<Eigen::Vector3f>& p, Random& random) {
  PointStore store(params, directionTable(params.approach.num_directions));
  std::vector<Eigen::Vector3f> q;
  for (std::size_t n = 0; n < p.size(); ++n) q.push_back(p[n] + random.point(3));
  store.addReturns(p, q);
  return store;
}

TEST(Neighbourhood, EqualsBruteForceOnTenThousandPoints) {
  Random random(1);
  const FieldParams params = pointParams(0.02);
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 14000; ++n) {
    Eigen::Vector3f x = random.point(1.2);
    if (n % 3 != 0) x.z() = 0.3f * std::sin(3 * x.x()) + 0.01f * x.z();  // a surface, and clutter
    p.push_back(x);
  }
  const PointStore store = storeOf(params, p, random);
  ASSERT_GT(store.size(), 10000u);
  const Counts counts = expectEqualToBruteForce(store, params, 4);
  EXPECT_GT(counts.full, 500u);
  EXPECT_GT(counts.partial, 100u);
}

/// The steps of each level of noise, and first returns, which have none.
TEST(Neighbourhood, EqualsBruteForceWithEachKindOfSteps) {
  for (const double noise_voxels : {0.3, 0.5, 1.0, 2.0, -1.0}) {
    SCOPED_TRACE(noise_voxels);
    Random random(7);
    FieldParams params = pointParams(0.02, 36, 30);
    params.tsdf.range_noise_m = std::max(0.0, noise_voxels * 0.02);
    params.scoring.mean_positions = noise_voxels >= 0;
    std::vector<Eigen::Vector3f> p;
    for (int n = 0; n < 6000; ++n) {
      Eigen::Vector3f x = random.point(0.5);
      x.z() = 0.3f * std::sin(3 * x.x()) + 0.05f * x.z();
      p.push_back(x);
    }
    const Counts counts = expectEqualToBruteForce(storeOf(params, p, random), params, 5);
    EXPECT_GT(counts.full, 500u);
    EXPECT_EQ(counts.rounded > 500, noise_voxels >= 0);
  }
}

/// Positions on a grid: most distances occur several times, so ids decide.
TEST(Neighbourhood, TiesGoToTheLowerId) {
  Random random(2);
  const FieldParams params = pointParams(0.0625, 36, 12);
  std::vector<Eigen::Vector3f> p;
  for (int x = 0; x < 14; ++x)
    for (int y = 0; y < 14; ++y)
      for (int z = 0; z < 5; ++z)
        p.emplace_back(0.0625f * static_cast<float>(x), 0.0625f * static_cast<float>(y),
                       0.0625f * static_cast<float>(z));
  std::shuffle(p.begin(), p.end(), random.engine());
  PointStore store(params, directionTable(36));
  for (std::size_t n = 0; n < p.size(); n += 70) {  // several scans: ids are not in the order of voxels
    const std::vector<Eigen::Vector3f> part(p.begin() + static_cast<std::ptrdiff_t>(n),
                                            p.begin() + static_cast<std::ptrdiff_t>(std::min(p.size(), n + 70)));
    std::vector<Eigen::Vector3f> q;
    for (const Eigen::Vector3f& x : part) q.push_back(x + random.point(3));
    store.addReturns(part, q);
  }
  EXPECT_GT(expectEqualToBruteForce(store, params, 1).full, 900u);
}

TEST(Neighbourhood, FarSparsePointsHaveNone) {
  Random random(3);
  const FieldParams params = pointParams(0.05);
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 60; ++n) p.push_back(random.point(40));
  for (int n = 0; n < 12; ++n) p.push_back(p[0] + random.point(0.3));
  const PointStore store = storeOf(params, p, random);
  const Counts counts = expectEqualToBruteForce(store, params, 1);
  EXPECT_GT(counts.without_normal, 50u);
  EXPECT_LT(counts.without_normal, counts.partial);
}

/// At 1 mm the radius of 0.1 m is a hundred voxels, many blocks wide.
TEST(Neighbourhood, SmallVoxelsLargeRadius) {
  Random random(4);
  const FieldParams params = pointParams(0.001);
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 350; ++n) p.push_back(random.point(0.26));
  const PointStore store = storeOf(params, p, random);
  const Counts counts = expectEqualToBruteForce(store, params, 1);
  EXPECT_GT(counts.full, 100u);
  EXPECT_GT(counts.partial, 50u);
}

TEST(Neighbourhood, OwnViewsOnlyWhereJoiningIsOff) {
  Random random(5);
  FieldParams params = pointParams(0.05, 36, 30);
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 500; ++n) p.push_back(random.point(0.4));
  const PointStore store = storeOf(params, p, random);
  expectEqualToBruteForce(store, params, 1);
  params.scoring.join_neighbour_views = false;
  expectEqualToBruteForce(store, params, 1);
}

/// Half a million voxels from the origin, float32 has 16 steps per voxel: means can be outside their voxel.
TEST(Neighbourhood, FarFromTheOrigin) {
  Random random(6);
  const FieldParams params = pointParams(0.01, 36, 10);
  std::vector<Eigen::Vector3f> p;
  const Eigen::Vector3f far(-5000, 5100, 4900);
  for (int n = 0; n < 2500; ++n) p.push_back(far + random.point(0.12));
  const PointStore store = storeOf(params, p, random);
  EXPECT_GT(expectEqualToBruteForce(store, params, 1).full, 1000u);
}

}  // namespace
}  // namespace accessvdb::internal
