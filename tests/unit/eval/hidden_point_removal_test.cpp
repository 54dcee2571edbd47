// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Hidden Point Removal against scenes whose visibility is known, and sets that are difficult for a hull.
///
/// The error bounds of HPR follow from the flip: samples an angle t apart are on a shell of radius 2 R, and the hull
/// between them sags by 2 R t^2 / 8. Points behind their neighbours by less show through; points in front of a deeper
/// step, closer than the angle whose sag is the step's height, are bridged over.
#include "eval/hidden_point_removal.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "accessvdb/error.h"

namespace accessvdb::eval {
namespace {

using Eigen::Vector3d;
using Flags = std::vector<std::uint8_t>;

std::vector<Vector3d> fibonacciSphere(int n, double radius_m, const Vector3d& centre_W) {
  std::vector<Vector3d> points;
  for (int i = 0; i < n; ++i) {
    const double z = 1 - (2 * i + 1.0) / n, angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double flat = std::sqrt(1 - z * z);
    points.push_back(centre_W + radius_m * Vector3d(flat * std::cos(angle), flat * std::sin(angle), z));
  }
  return points;
}

TEST(HiddenPointRemoval, SphereIsSeenUpToItsSilhouette) {
  constexpr int kPoints = 4000;
  constexpr double kDistance_m = 4;
  const Vector3d centre(0.3, -7, 2), towards = Vector3d(1, 2, -0.5).normalized();
  const auto points = fibonacciSphere(kPoints, 1, centre);
  const Flags seen = visibleFrom(points, centre + kDistance_m * towards);
  // Spacing of the samples, seen from the viewer at the silhouette; the next sample may be twice as far.
  const double angle = 2 * std::sqrt(4 * std::numbers::pi / kPoints) / std::sqrt(kDistance_m * kDistance_m - 1);
  const double sag_m = 2 * kFlipRadius * (kDistance_m + 1) * angle * angle / 8;
  std::size_t front = 0, back = 0;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const double height = (points[n] - centre).dot(towards);  // the silhouette is the circle at 1 / distance
    if (height > 1 / kDistance_m + 1e-9) {
      ++front;
      ASSERT_EQ(seen[n], 1) << height;  // the flipped front is strictly convex, so each of its samples is a corner
    } else if (height < 1 / kDistance_m - sag_m) {
      ++back;
      ASSERT_EQ(seen[n], 0) << height;
    }
  }
  EXPECT_GT(front, 1400u);
  EXPECT_GT(back, 2200u);
}

TEST(HiddenPointRemoval, APlateHidesWhatLiesInItsShadow) {
  // A plate at z = 1 in front of a wall at z = 2, seen from the origin: by brute force, is the ray through the plate?
  std::vector<Vector3d> points;
  constexpr double kStep_m = 0.02;
  for (int i = -25; i <= 25; ++i) {
    for (int j = -25; j <= 25; ++j) points.emplace_back(i * kStep_m, j * kStep_m, 1);
  }
  const std::size_t plate = points.size();
  std::mt19937 random(4);
  const auto uniform = [&] { return 4.0 * static_cast<double>(random()) / 4294967295.0 - 2; };
  for (int n = 0; n < 20000; ++n) points.emplace_back(uniform(), uniform(), 2);
  const Flags seen = visibleFrom(points, Vector3d::Zero());
  const double farthest = std::sqrt(12.0);
  const double bridged_rad = std::sqrt(8 / (2 * kFlipRadius * farthest));  // sag of the step's height, 1 m and more
  std::size_t hidden = 0, free = 0;
  for (std::size_t n = 0; n < points.size(); ++n) {
    const Vector3d& p = points[n];
    const double outside =
        std::max(std::abs(p.x()), std::abs(p.y())) / p.z() - 0.5;  // distance beyond the plate's edge
    if (n < plate) {
      ASSERT_EQ(seen[n], 1);
    } else if (outside < 0) {
      ++hidden;
      ASSERT_EQ(seen[n], 0) << p.transpose();
    } else if (outside > 2.5 * bridged_rad) {  // a slope changes up to 2.25 times as fast as its angle out there
      ++free;
      ASSERT_EQ(seen[n], 1) << p.transpose();
    }
  }
  EXPECT_GT(hidden, 3000u);
  EXPECT_GT(free, 3000u);
}

TEST(HiddenPointRemoval, ViewersTogetherSeeWhatAnyOfThemSees) {
  const auto points = fibonacciSphere(2000, 0.2, {1, 1, 1});
  std::vector<Vector3d> viewers;
  for (int n = 0; n < 7; ++n) viewers.emplace_back(1 + std::cos(n), 1 + std::sin(n), 1.2);
  Flags expected(points.size(), 0);
  for (const Vector3d& viewer : viewers) {
    const Flags one = visibleFrom(points, viewer);
    EXPECT_GT(std::count(one.begin(), one.end(), 0), 500);
    for (std::size_t n = 0; n < expected.size(); ++n) expected[n] |= one[n];
  }
  EXPECT_EQ(visibleFromAny(points, viewers), expected);
  EXPECT_GT(std::count(expected.begin(), expected.end(), 1), 1500);

  // Neither order nor duplicates matter.
  std::vector<std::uint32_t> order(points.size());
  for (std::uint32_t n = 0; n < order.size(); ++n) order[n] = n;
  std::shuffle(order.begin(), order.end(), std::mt19937(9));
  std::vector<Vector3d> shuffled;
  for (const std::uint32_t n : order) shuffled.push_back(points[n]);
  for (std::size_t n = 0; n < points.size(); ++n) shuffled.push_back(points[n]);
  const Flags again = visibleFromAny(shuffled, viewers);
  for (std::size_t n = 0; n < order.size(); ++n) ASSERT_EQ(again[n], expected[order[n]]);
  for (std::size_t n = 0; n < points.size(); ++n) ASSERT_EQ(again[points.size() + n], expected[n]);
}

TEST(HiddenPointRemoval, SmallAndFlatSetsHaveAnAnswerAndSayNothing) {
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const Vector3d q(0, 0, 0);
  const auto seen = [&](const std::vector<Vector3d>& points) { return visibleFrom(points, q); };
  EXPECT_EQ(seen({}), Flags{});
  EXPECT_EQ(visibleFromAny(std::vector<Vector3d>{{1, 2, 3}}, {}), Flags{0}) << "no viewer";
  EXPECT_EQ(seen({{1, 2, 3}}), Flags{1});
  EXPECT_EQ(seen({{1, 2, 3}, {1, 2, 3}, {1, 2, 3}, {1, 2, 3}, {1, 2, 3}}), (Flags{1, 1, 1, 1, 1}));
  // On one ray the nearest is seen, on a line through the viewer one on each side.
  EXPECT_EQ(seen({{2, 0, 0}, {1, 0, 0}, {3, 0, 0}}), (Flags{0, 1, 0}));
  EXPECT_EQ(seen({{2, 2, 2}, {1, 1, 1}, {3, 3, 3}, {-4, -4, -4}, {-5, -5, -5}, {7, 7, 7}}), (Flags{0, 1, 0, 1, 0, 0}));
  // In a plane with the viewer: a near pair of points and one far behind the gap is seen, one behind a point is not.
  EXPECT_EQ(seen({{1, 0.5, 0}, {1, -0.5, 0}, {2, 1, 0}}), (Flags{1, 1, 0}));
  std::vector<Vector3d> ring;  // two rings in a tilted plane, the far one behind the near one
  const Vector3d a = Vector3d(1, 1, 0.3).normalized(), b = a.cross(Vector3d(0.1, -0.4, 2)).normalized();
  for (const double radius : {1.0, 2.0}) {
    for (int n = 0; n < 40; ++n) ring.push_back(radius * (std::cos(n * 0.157) * a + std::sin(n * 0.157) * b));
  }
  const Flags of_ring = seen(ring);
  for (std::size_t n = 0; n < ring.size(); ++n) EXPECT_EQ(of_ring[n], n < 40 ? 1 : 0) << n;
  // Four corners of a plane that the viewer is not in; the fifth is behind their middle, the sixth at the viewer.
  EXPECT_EQ(seen({{1, 1, 1}, {-1, 1, 1}, {1, -1, 1}, {-1, -1, 1}, {0.5, 0.5, 1}, {2, 2, 2}, {0, 0, 0}}),
            (Flags{1, 1, 1, 1, 1, 0, 1}));
  // Far away and far from the origin.
  EXPECT_EQ(visibleFrom(std::vector<Vector3d>{{5e6 + 1, 4e6, 1}, {5e6 + 2, 4e6, 2}, {5e6 + 1, 4e6 + 1, 0}},
                        Vector3d(5e6, 4e6, 0)),
            (Flags{1, 0, 1}));
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(HiddenPointRemoval, RandomGridsWithManyTiesNeverFail) {
  // Integer coordinates: many points in common planes, on common rays, at the viewer.
  std::mt19937 random(11);
  for (int round = 0; round < 300; ++round) {
    std::vector<Vector3d> points;
    const int count = 1 + static_cast<int>(random() % 40);
    const bool flat = round % 3 == 0;
    for (int n = 0; n < count; ++n) {
      points.emplace_back(static_cast<double>(random() % 5), static_cast<double>(random() % 5),
                          flat ? 0.0 : static_cast<double>(random() % 5));
    }
    const Vector3d viewer(static_cast<double>(random() % 5), static_cast<double>(random() % 5), 0);
    const Flags seen = visibleFrom(points, viewer);
    // A point exactly behind another one is hidden by it; the nearest of all is seen.
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if ((points[i] - viewer).norm() < (points[nearest] - viewer).norm()) nearest = i;
      for (std::size_t j = 0; j < points.size(); ++j) {
        const Vector3d x = points[i] - viewer, y = points[j] - viewer;
        const bool behind = x.cross(y).norm() == 0 && x.dot(y) > 0 && x.norm() > y.norm();
        ASSERT_FALSE(behind && seen[i] == 1) << "round " << round;
      }
    }
    ASSERT_EQ(seen[nearest], 1) << "round " << round;
  }
}

TEST(HiddenPointRemoval, NumbersThatAreNotFiniteAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinite = std::numeric_limits<double>::infinity();
  const std::vector<Vector3d> good = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}};
  EXPECT_THROW((void)visibleFrom(std::vector<Vector3d>{{nan, 0, 0}}, {0, 0, 0}), InvalidArgument);
  EXPECT_THROW((void)visibleFrom(std::vector<Vector3d>{{0, infinite, 0}}, {0, 0, 0}), InvalidArgument);
  EXPECT_THROW((void)visibleFrom(good, {0, 0, nan}), InvalidArgument);
  EXPECT_THROW((void)visibleFromAny(good, std::vector<Vector3d>{{0, 0, 0}, {infinite, 0, 0}}), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::eval
