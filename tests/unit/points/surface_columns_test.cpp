// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One point where the surface is: on surfaces that are known, and against all pairs of random points.
#include "points/surface_columns.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>

#include "points/neighbourhood.h"
#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

constexpr double kFine_m = 0.01, kNoise_m = 0.02;
/// Of a square, and returns in a scan of it: ten scans bring a dozen returns above each of its voxels.
constexpr double kEdge_m = 0.4;
constexpr std::size_t kReturns = 2000;

FieldParams spacedParams(double spacing_m, double voxel_size_m = kFine_m, double noise_m = kNoise_m) {
  const int neighbours = noise_m < voxel_size_m / 2 ? 10 : noise_m < 2 * voxel_size_m ? 60 : 100;
  FieldParams params = pointParams(voxel_size_m, 36, neighbours);
  params.tsdf.range_noise_m = noise_m;
  params.tsdf.truncation_distance_m = std::max(4 * voxel_size_m, 5 * noise_m);
  params.scoring.point_spacing_m = spacing_m;
  return params;
}

double gaussian(Random& random) {
  double sum = -6;
  for (int n = 0; n < 12; ++n) sum += random.uniform(0, 1);
  return sum;
}

struct Made {
  PointStore points;
  std::vector<Neighbourhood> found;

  explicit Made(const FieldParams& params) : points(params, directionTable(36)) {}
  void find(const FieldParams& params) {
    std::vector<std::uint32_t> ids(points.size());
    std::iota(ids.begin(), ids.end(), 0u);
    found.resize(ids.size());
    NeighbourhoodSearch(points, params).compute(ids, found);
  }
  [[nodiscard]] bool isChosen(std::uint32_t id) const { return !found[id].normal_L.isZero(); }
};

/// Returns from a square in z = height_m, seen along z from one side.
void addPlane(Made& made, Random& random, double height_m, double from_m, double noise_m) {
  std::vector<Eigen::Vector3f> p;
  for (std::size_t n = 0; n < kReturns; ++n) {
    p.emplace_back(static_cast<float>(random.uniform(0, kEdge_m)), static_cast<float>(random.uniform(0, kEdge_m)),
                   static_cast<float>(height_m + noise_m * gaussian(random)));
  }
  const Eigen::Vector3f q(0.2f, 0.2f, static_cast<float>(height_m + from_m));
  made.points.addReturns(p, {&q, 1});
}

struct Gaps {
  double worst_m = 0, mean_m = 0;
};

/// From places on a square surface to the nearest chosen point of those that count.
template <typename At, typename Counts>
Gaps gapsOf(const Made& made, const At& at, const Counts& counts) {
  std::vector<Eigen::Vector3d> chosen;
  for (std::uint32_t id = 0; id < made.points.size(); ++id) {
    if (made.isChosen(id) && counts(id)) chosen.push_back(made.points.pca_L(id).cast<double>());
  }
  Gaps gaps;
  int places = 0;
  for (double x = 0.03; x < kEdge_m - 0.03; x += 0.005) {
    for (double y = 0.03; y < kEdge_m - 0.03; y += 0.005, ++places) {
      double least_m = 1;
      for (const Eigen::Vector3d& p : chosen) least_m = std::min(least_m, (p - at(x, y)).norm());
      gaps.worst_m = std::max(gaps.worst_m, least_m);
      gaps.mean_m += least_m;
    }
  }
  gaps.mean_m /= places;
  return gaps;
}

/// Noise of two voxels fills a band of eight layers with points. About one in each cell is chosen, near the plane, and
/// none is farther from one than noise and cells explain.
TEST(SurfaceColumns, OfANoisyPlaneKeepTheMiddle) {
  for (const int edge : {1, 2}) {
    const FieldParams params = spacedParams(edge * kFine_m);
    Made made(params);
    Random random(1);
    for (int scan = 0; scan < 10; ++scan) addPlane(made, random, 0.003, 2, kNoise_m);
    made.find(params);
    const double cells = std::pow(kEdge_m / (edge * kFine_m), 2);
    double chosen = 0, off_m = 0, all_off_m = 0;
    for (std::uint32_t id = 0; id < made.points.size(); ++id) {
      const double z_m = std::abs(static_cast<double>(made.points.pca_L(id).z()) - 0.003);
      all_off_m += z_m;
      if (!made.isChosen(id)) continue;
      ++chosen;
      off_m += z_m;
    }
    EXPECT_GT(made.points.size(), 5 * edge * edge * cells);
    EXPECT_LT(chosen, 1.4 * cells) << edge;
    EXPECT_GT(chosen, 0.7 * cells) << edge;
    EXPECT_LT(off_m / chosen, 0.75 * all_off_m / made.points.size()) << edge;
    const Gaps gaps = gapsOf(
        made, [](double x, double y) { return Eigen::Vector3d(x, y, 0.003); }, [](std::uint32_t) { return true; });
    EXPECT_LT(gaps.worst_m, 2 * kNoise_m) << edge;
    EXPECT_LT(gaps.mean_m, 0.7 * kNoise_m) << edge;
  }
}

/// A plate seen from both sides has points of both, although they lie within the window of each other.
TEST(SurfaceColumns, OfAThinPlateKeepBothSides) {
  for (const double thickness_m : {0.02, 0.035}) {
    const FieldParams params = spacedParams(kFine_m, kFine_m, 0.01);
    Made made(params);
    Random random(2);
    for (int scan = 0; scan < 6; ++scan) {
      addPlane(made, random, 0, -2, 0.01);
      addPlane(made, random, thickness_m, 2, 0.01);
    }
    made.find(params);
    for (const double side : {-1.0, 1.0}) {
      const double z_m = side < 0 ? 0 : thickness_m;
      const Gaps gaps = gapsOf(
          made, [=](double x, double y) { return Eigen::Vector3d(x, y, z_m); },
          [&](std::uint32_t id) { return side * static_cast<double>(made.points.toSensor_L(id).z()) > 0; });
      EXPECT_LT(gaps.worst_m, 0.025) << thickness_m << side;
      EXPECT_LT(gaps.mean_m, 0.009) << thickness_m << side;
    }
  }
}

/// Where a floor and a wall meet, both keep their points up to the corner.
TEST(SurfaceColumns, OfACornerKeepFloorAndWall) {
  const FieldParams params = spacedParams(kFine_m, kFine_m, 0.01);
  Made made(params);
  Random random(3);
  const Eigen::Vector3f q(2, 0.2f, 2);
  for (int scan = 0; scan < 6; ++scan) {
    std::vector<Eigen::Vector3f> p;
    for (std::size_t n = 0; n < 2 * kReturns; ++n) {
      const auto along = static_cast<float>(random.uniform(0, kEdge_m)),
                 up = static_cast<float>(random.uniform(0, kEdge_m));
      const auto off = static_cast<float>(0.01 * gaussian(random));
      p.push_back(n % 2 == 0 ? Eigen::Vector3f(up, along, off) : Eigen::Vector3f(off, along, up));
    }
    made.points.addReturns(p, {&q, 1});
  }
  made.find(params);
  const auto all = [](std::uint32_t) { return true; };
  const Gaps floor = gapsOf(
      made, [](double x, double y) { return Eigen::Vector3d(x, y, 0); }, all);
  const Gaps wall = gapsOf(
      made, [](double z, double y) { return Eigen::Vector3d(0, y, z); }, all);
  for (const Gaps& gaps : {floor, wall}) {
    EXPECT_LT(gaps.worst_m, 0.025);
    EXPECT_LT(gaps.mean_m, 0.009);
  }
}

/// In the words of the design and over all pairs, in metres and doubles: exact, because heights are whole numbers.
bool isNearestOfAll(const PointStore& points, std::uint32_t id, int axis, const FieldParams& params) {
  const double v = params.tsdf.voxel_size_m;
  const int edge = std::max(1, static_cast<int>(std::lround(params.scoring.point_spacing_m / v)));
  const double window = std::floor(std::min(std::max(2 * params.tsdf.range_noise_m, params.scoring.point_spacing_m),
                                            params.tsdf.truncation_distance_m) *
                                   (1024 / v));
  const auto height = [&](std::uint32_t n) { return std::floor(double(points.pca_L(n)[axis]) * (1024 / v)); };
  const auto voxel = [&](std::uint32_t n) { return points.voxelOf(points.first_L(n)); };
  const auto front = [&](std::uint32_t n) { return points.meanSensor_L(n)[axis] >= double(points.first_L(n)[axis]); };
  std::vector<std::uint32_t> within;
  double returns = 0, sum = 0;
  for (std::uint32_t other = 0; other < points.size(); ++other) {
    bool competes = std::abs(height(other) - height(id)) <= window && front(other) == front(id);
    for (int k = 0; k < 3; ++k) {
      const auto cell = [&](std::uint32_t n) {
        return std::floor(double(voxel(n)[static_cast<std::size_t>(k)]) / edge);
      };
      competes = competes && (k == axis || cell(other) == cell(id));
    }
    if (!competes) continue;
    within.push_back(other);
    returns += points.stored(other).sums.returns;
    sum += points.stored(other).sums.returns * (height(other) - height(id));
  }
  const auto rank = [&](std::uint32_t n) {
    const double up = height(n) - height(id);
    return std::tuple(std::abs(returns * up - sum), up, voxel(n));
  };
  return *std::ranges::min_element(within, {}, rank) == id;
}

TEST(SurfaceColumns, EqualBruteForce) {
  struct Case {
    double spacing_m, voxel_size_m, noise_m;
  };
  for (const Case& c :
       {Case{0.01, 0.01, 0.02}, Case{0.03, 0.01, 0.01}, Case{0.05, 0.05, 0.02}, Case{0.06, 0.02, 0.0}}) {
    const FieldParams params = spacedParams(c.spacing_m, c.voxel_size_m, c.noise_m);
    Made made(params);
    Random random(4);
    for (int scan = 0; scan < 4; ++scan) {
      std::vector<Eigen::Vector3f> p;
      for (int n = 0; n < 700; ++n) {
        Eigen::Vector3f x = random.point(12 * c.voxel_size_m);
        x.z() = 0.3f * x.x() + static_cast<float>(c.noise_m + 0.2 * c.voxel_size_m) * x.z();
        p.push_back(x);
      }
      const Eigen::Vector3f q = random.point(2);
      made.points.addReturns(p, {&q, 1});
    }
    made.find(params);
    FieldParams all = params;
    all.scoring.point_spacing_m = 0;
    const std::vector<Neighbourhood> spaced = std::move(made.found);
    made.find(all);
    std::size_t chosen = 0, beside = 0;
    for (std::uint32_t id = 0; id < made.points.size(); ++id) {
      const Eigen::Vector3f &normal = made.found[id].normal_L, &kept = spaced[id].normal_L;
      if (normal.isZero()) continue;
      int axis = 0;
      normal.cwiseAbs().maxCoeff(&axis);
      const bool expected = isNearestOfAll(made.points, id, axis, params);
      ASSERT_EQ(kept, expected ? normal : Eigen::Vector3f(0, 0, 0)) << id;
      ASSERT_EQ(kernels::besideSurfaceAxis(kept.data()), expected ? -1 : axis) << id;
      ++(expected ? chosen : beside);
    }
    EXPECT_GT(chosen, 100u) << c.spacing_m;
    EXPECT_GT(beside, 100u) << c.spacing_m;
  }
}

}  // namespace
}  // namespace accessvdb::internal
