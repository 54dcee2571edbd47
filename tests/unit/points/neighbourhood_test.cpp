// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Neighbours against brute force, compared by the results: reach, normal, joined views.
#include "points/neighbourhood.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

#include "hostdev/surface_normal.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

/// The largest power of two that makes at most 2^20 steps of a radius.
double stepsPerMetre(double radius) {
  double steps = 1;
  while (steps * radius <= 0x1p20) steps *= 2;
  return steps / 2;
}

/// Offset of another point, rounded to whole steps (docs/DESIGN.md, "Exact updates").
Eigen::Vector3d offsetInSteps(const PointStore& points, std::uint32_t from, std::uint32_t to, double radius) {
  const Eigen::Vector3d metres = points.pca_L(to).cast<double>() - points.pca_L(from).cast<double>();
  return (metres * stepsPerMetre(radius) + Eigen::Vector3d::Constant(0.5)).array().floor();
}

/// The k nearest within the radius by (squared distance in steps, id), by exhaustive search.
std::vector<std::uint32_t> nearest(const PointStore& points, std::uint32_t id, std::size_t k, double radius) {
  std::vector<std::pair<double, std::uint32_t>> found;
  const double most = std::floor(radius * stepsPerMetre(radius));
  for (std::uint32_t other = 0; other < points.size(); ++other) {
    const double squared = offsetInSteps(points, id, other, radius).squaredNorm();  // below 2^53: exact
    if (squared <= most * most) found.emplace_back(squared, other);
  }
  std::sort(found.begin(), found.end());
  if (found.size() > k) found.resize(k);
  std::vector<std::uint32_t> ids;
  for (const auto& [squared, other] : found) ids.push_back(other);
  return ids;
}

struct Counts {
  std::size_t full = 0, partial = 0, without_normal = 0;
};

Counts expectEqualToBruteForce(const PointStore& points, const FieldParams& params, std::uint32_t every) {
  const NeighbourhoodSearch search(points, params);
  const auto k = static_cast<std::size_t>(params.scoring.neighbours);
  std::vector<std::uint32_t> ids(points.size());
  std::iota(ids.begin(), ids.end(), 0u);
  std::shuffle(ids.begin(), ids.end(), std::mt19937_64(1));
  std::vector<Neighbourhood> found(ids.size());
  search.compute(ids, found);
  Counts counts;
  for (std::size_t n = 0; n < ids.size(); n += every) {
    const std::vector<std::uint32_t> near = nearest(points, ids[n], k, search.radius_m());
    const Eigen::Vector3d centre = points.pca_L(ids[n]).cast<double>();
    DirectionMask seen = points.seen(ids[n]);
    for (std::size_t m = 0; m < std::min<std::size_t>(near.size(), 10); ++m) seen = seen | points.seen(near[m]);
    EXPECT_TRUE(found[n].seen == (params.scoring.join_neighbour_views ? seen : points.seen(ids[n]))) << ids[n];
    if (near.size() < k) {
      EXPECT_GE(found[n].reach_m, static_cast<float>(search.radius_m()));
      EXPECT_LT(found[n].reach_m, 1.00001 * search.radius_m());
      ++counts.partial;
    } else {
      const double farthest = (points.pca_L(near.back()).cast<double>() - centre).norm();
      EXPECT_GE(found[n].reach_m, static_cast<float>(farthest)) << ids[n];
      EXPECT_LT(found[n].reach_m, farthest + 1e-5 * search.radius_m()) << ids[n];
      ++counts.full;
    }
    if (near.size() < 3) {
      EXPECT_TRUE(found[n].normal_L.isZero());
      ++counts.without_normal;
      continue;
    }
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const std::uint32_t id : near) mean += offsetInSteps(points, ids[n], id, search.radius_m());
    mean /= static_cast<double>(near.size());
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    for (const std::uint32_t id : near) {
      const Eigen::Vector3d e = offsetInSteps(points, ids[n], id, search.radius_m()) - mean;
      m += e * e.transpose();
    }
    // The solver has its own test; here it shows whether the same neighbours were used.
    Eigen::Vector3f normal;
    kernels::smallestEigenvector({m(0, 0), m(0, 1), m(0, 2), m(1, 1), m(1, 2), m(2, 2)}, normal.data());
    EXPECT_LT(normal.cast<double>().cross(found[n].normal_L.cast<double>()).norm(), 1e-6) << ids[n];
    const Eigen::Vector3d to_sensor = points.meanSensor_L(ids[n]) - points.first_L(ids[n]).cast<double>();
    EXPECT_GE(found[n].normal_L.cast<double>().dot(to_sensor), 0) << ids[n];
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
