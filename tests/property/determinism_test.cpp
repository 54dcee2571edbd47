// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The outcome is a function of the returns of each scan: it does not depend on threads, on their order, or on the
/// world's origin, and it rotates with the world.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "support/determinism_support.h"
#include "support/same_map.h"

namespace accessvdb::test {
namespace {

FieldParams paramsOf(double voxel_size_m, int threads, UpdatePolicy policy) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.threads = threads;
  params.update.policy = policy;
  return params;
}

AccessibilityField run(const std::vector<Scan>& scans, const FieldParams& params) {
  AccessibilityField field(armTool(), params);
  for (const Scan& scan : scans) {
    field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
  }
  return field;
}

TEST(Determinism, ThreadsAndOrderDoNotMatter) {
  for (const UpdatePolicy policy : {UpdatePolicy::Exact, UpdatePolicy::Paper}) {
    std::vector<Scan> scans = wallScans(1, 4, 450);
    const AccessibilityField expected = run(scans, paramsOf(0.05, 1, policy));
    const FieldSnapshot snapshot = expected.snapshot();
    expectVaried(snapshot);
    std::mt19937_64 random(7);
    for (const int threads : {1, 2, 4, 16}) {
      // The paper's policy draws returns by their place in the scan: its result is only the same for the same order.
      if (policy == UpdatePolicy::Exact) {
        for (Scan& scan : scans) std::shuffle(scan.points_S.begin(), scan.points_S.end(), random);
      }
      const AccessibilityField field = run(scans, paramsOf(0.05, threads, policy));
      SCOPED_TRACE((policy == UpdatePolicy::Exact ? "exact, threads " : "paper, threads ") + std::to_string(threads));
      expectSame(field.snapshot(), snapshot);
      expectSameMap(field.volume(), expected.volume());
      if (HasFatalFailure()) return;
    }
  }
}

/// The same where one point is scored where the surface is.
TEST(Determinism, ThreadsAndOrderDoNotDecideWhichPointsAreScored) {
  std::vector<Scan> scans = wallScans(3, 5, 700);
  FieldParams params = paramsOf(0.05, 1, UpdatePolicy::Exact);
  params.scoring.point_spacing_m = 0.1;
  const FieldSnapshot expected = run(scans, params).snapshot();
  expectVaried(expected);
  EXPECT_GT(expected.reasons()[static_cast<std::size_t>(PointReason::BesideSurface)], 100u);
  std::mt19937_64 random(8);
  for (const int threads : {1, 2, 4, 16}) {
    for (Scan& scan : scans) std::shuffle(scan.points_S.begin(), scan.points_S.end(), random);
    params.threads = threads;
    SCOPED_TRACE(threads);
    expectSame(run(scans, params).snapshot(), expected);
    if (HasFatalFailure()) return;
  }
}

/// Whole voxels, far away: half a million metres east, five and a half million north (as in UTM), 300 m up. With a
/// voxel of 1/16 m every step is exact in double; with 0.05 m positions are off by 1e-9 m, which the rounding of local
/// positions to 2^-20 m absorbs (unless one is within 1e-9 m of a rounding bound, and none of these is).
TEST(Determinism, ShiftingTheWorldByWholeVoxelsChangesNothing) {
  for (const double v : {0.0625, 0.05}) {
    std::vector<Scan> scans = wallScans(2, 5, 700);
    const FieldSnapshot here = run(scans, paramsOf(v, 0, UpdatePolicy::Exact)).snapshot();
    expectVaried(here);
    const Eigen::Vector3d shift = (Eigen::Vector3d(500000, 5600000, 300) / v).array().round() * v;
    for (Scan& scan : scans) scan.T_W_S.translation() += shift;
    const FieldSnapshot there = run(scans, paramsOf(v, 0, UpdatePolicy::Exact)).snapshot();
    ASSERT_EQ(here.points.size(), there.points.size());
    EXPECT_LT((there.origin_W - here.origin_W - shift).norm(), 1e-8);
    for (std::size_t n = 0; n < here.points.size(); ++n) {
      ASSERT_TRUE(sameVerdict(here.points[n], there.points[n])) << n;
      ASSERT_LT((there.points[n].position_W - here.points[n].position_W - shift).norm(), 1e-8);
    }
  }
}

/// Quarter turns map the voxel grid onto itself. What does not rotate with the world is left out of the scans: the
/// first return of a voxel is the least by (x, y, z), so each scan has one return per voxel; none is on a voxel's
/// bound.
TEST(Determinism, QuarterTurnsTurnTheBestDirection) {
  constexpr double kVoxel = 0.05;
  constexpr int kDirections = 180;
  struct Rays {
    std::vector<Eigen::Vector3d> p, q;
  };
  const auto turned = [](const Eigen::Vector3d& x, int quarters) {
    Eigen::Vector3d y = x;
    for (int n = 0; n < quarters; ++n) y = Eigen::Vector3d(-y.y(), y.x(), y.z());
    return y;
  };
  const auto voxelOf = [&](const Eigen::Vector3d& x) {
    return std::array<long, 3>{std::lround(x.x() / kVoxel), std::lround(x.y() / kVoxel), std::lround(x.z() / kVoxel)};
  };
  std::vector<Rays> scans;
  for (const Scan& scan : wallScans(3, 5, 900)) {
    Rays& rays = scans.emplace_back();
    std::set<std::array<long, 3>> taken;
    for (const Eigen::Vector3f& p_S : scan.points_S) {
      const Eigen::Vector3d p = scan.T_W_S * p_S.cast<double>();
      const Eigen::Array3d inside = p.array() / kVoxel - (p.array() / kVoxel).round();
      if ((inside.abs() > 0.49).any() || !taken.insert(voxelOf(p)).second) continue;
      rays.p.push_back(p);
      rays.q.push_back(scan.T_W_S.translation());
    }
  }
  const auto fieldOf = [&](int quarters) {
    AccessibilityField field(armTool(), paramsOf(kVoxel, 0, UpdatePolicy::Exact));
    for (const Rays& rays : scans) {
      std::vector<Eigen::Vector3d> p, q;
      for (const Eigen::Vector3d& x : rays.p) p.push_back(turned(x, quarters));
      for (const Eigen::Vector3d& x : rays.q) q.push_back(turned(x, quarters));
      field.integrateRays(p, q);
    }
    field.update();
    return field.snapshot();
  };
  const FieldSnapshot straight = fieldOf(0);
  expectVaried(straight);
  std::map<std::array<long, 3>, const SurfacePoint*> at;
  for (int quarters = 1; quarters < 4; ++quarters) {
    const FieldSnapshot field = fieldOf(quarters);
    ASSERT_EQ(field.points.size(), straight.points.size());
    at.clear();
    for (const SurfacePoint& point : field.points) at[voxelOf(point.position_W)] = &point;
    for (const SurfacePoint& point : straight.points) {
      const auto found = at.find(voxelOf(turned(point.position_W, quarters)));
      ASSERT_NE(found, at.end());
      const SurfacePoint& other = *found->second;
      ASSERT_STREQ(name(other.label), name(point.label)) << "quarter turns " << quarters;
      ASSERT_STREQ(name(other.reason), name(point.reason)) << "quarter turns " << quarters;
      ASSERT_EQ(other.score, point.score);
      const int expected =
          point.direction == kNoDirection ? kNoDirection : (point.direction + quarters * kDirections / 4) % kDirections;
      ASSERT_EQ(other.direction, expected) << "quarter turns " << quarters;
    }
  }
}

}  // namespace
}  // namespace accessvdb::test
