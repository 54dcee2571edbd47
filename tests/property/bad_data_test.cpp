// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bad returns, poses and parameters: counted or refused, never used.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "accessvdb/error.h"
#include "support/determinism_support.h"
#include "support/same_map.h"

namespace accessvdb::test {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();

std::uint64_t dropped(const FrameStats& stats, DropReason reason) {
  return stats.dropped[static_cast<std::size_t>(reason)];
}

FieldParams coarse() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  return params;
}

TEST(BadData, InsertedReturnsChangeNothingAndAreCounted) {
  struct Bad {
    Eigen::Vector3f p;
    DropReason reason;
  };
  const std::vector<Bad> kinds = {{{kNaN, 1, 1}, DropReason::NonFinite},
                                  {{1, kNaN, 1}, DropReason::NonFinite},
                                  {{1, 1, kNaN}, DropReason::NonFinite},
                                  {{kInf, 0, 0}, DropReason::NonFinite},
                                  {{0, -kInf, kInf}, DropReason::NonFinite},
                                  {{1e30f, 1, 1}, DropReason::OutOfBounds},
                                  {{1, 1, -1e30f}, DropReason::OutOfBounds},
                                  {{0, 0, 0}, DropReason::NoReturn},
                                  {{-0.0f, 0, 0}, DropReason::NoReturn},
                                  {{0, kNaN, 0}, DropReason::NonFinite},
                                  {{3.4e38f, 3.4e38f, 3.4e38f}, DropReason::OutOfBounds}};
  const std::vector<Scan> scans = wallScans(4, 5, 700);
  AccessibilityField clean(armTool(), coarse()), soiled(armTool(), coarse());
  std::mt19937_64 random(3);
  std::uint64_t inserted = 0;
  for (const Scan& scan : scans) {
    clean.integrateScan(scan.points_S, scan.T_W_S);
    clean.update();
    Scan bad = scan;
    std::array<std::uint64_t, kNumDropReasons> expected = {};
    for (int n = 0; n < 250; ++n) {
      const Bad& kind = kinds[random() % kinds.size()];
      bad.points_S.insert(bad.points_S.begin() + static_cast<std::ptrdiff_t>(random() % (bad.points_S.size() + 1)),
                          kind.p);
      ++expected[static_cast<std::size_t>(kind.reason)];
      ++inserted;
    }
    const FrameStats stats = soiled.integrateScan(bad.points_S, bad.T_W_S);
    soiled.update();
    EXPECT_EQ(stats.dropped, expected);
    EXPECT_EQ(stats.points_in, bad.points_S.size());
    EXPECT_EQ(stats.points_used, scan.points_S.size());
  }
  EXPECT_GE(inserted, 1000u);
  expectVaried(clean.snapshot());
  expectSame(soiled.snapshot(), clean.snapshot());
  expectSameMap(soiled.volume(), clean.volume());
}

TEST(BadData, RangeLimitsDropByReason) {
  FieldParams params = coarse();
  params.tsdf.min_range_m = 0.5;
  params.tsdf.max_range_m = 3;
  AccessibilityField field(armTool(), params);
  const std::vector<Eigen::Vector3f> points = {{0.4f, 0, 0},  {0.6f, 0, 0}, {0, 2.9f, 0}, {0, 0, 3.1f},
                                               {1e30f, 0, 0}, {0, 0, 0},    {kNaN, 0, 0}};
  const FrameStats stats = field.integrateScan(points, Eigen::Isometry3d::Identity());
  EXPECT_EQ(stats.points_used, 2u);
  EXPECT_EQ(dropped(stats, DropReason::BelowMinRange), 1u);
  EXPECT_EQ(dropped(stats, DropReason::BeyondMaxRange), 2u);
  EXPECT_EQ(dropped(stats, DropReason::NoReturn), 1u);
  EXPECT_EQ(dropped(stats, DropReason::NonFinite), 1u);
}

/// Rays so short that their squares underflow: whether used or not, they must not produce NaN.
TEST(BadData, VanishingRangesLeaveNoNaN) {
  AccessibilityField field(armTool(), coarse());
  std::vector<Eigen::Vector3f> points;
  for (const float range : {1e-45f, 1e-38f, 1e-30f, 1e-20f, 1e-10f, 1e-7f, 1e-4f}) {
    points.emplace_back(range, 0, 0);
    points.emplace_back(-range, range, range);
  }
  for (int n = 0; n < 3; ++n) field.integrateScan(points, Eigen::Isometry3d::Identity());
  field.update();
  const auto distance = field.volume().distance();
  for (auto value = distance->cbeginValueOn(); value; ++value) ASSERT_TRUE(std::isfinite(*value));
  for (const SurfacePoint& point : field.snapshot().points) {
    ASSERT_TRUE(point.position_W.allFinite() && point.normal_W.allFinite());
  }
}

TEST(BadData, OnlyBadReturnsLeaveAnEmptyField) {
  AccessibilityField field(armTool(), coarse());
  const std::vector<Eigen::Vector3f> points(100, Eigen::Vector3f(kNaN, 0, 0));
  EXPECT_EQ(field.integrateScan(points, Eigen::Isometry3d::Identity()).points_used, 0u);
  EXPECT_EQ(field.integrateScan({}, Eigen::Isometry3d::Identity()).points_in, 0u);
  field.update();
  EXPECT_TRUE(field.snapshot().points.empty());
  EXPECT_TRUE(field.evaluateFromScratch().points.empty());
  EXPECT_EQ(field.volume().leafCount(), 0u);
  EXPECT_FALSE(field.pointAt({0, 0, 0}).has_value());
  EXPECT_FALSE(field.pointAt({kNaN, 0, 0}).has_value());
}

TEST(BadData, BadPosesAreRefusedAndChangeNothing) {
  const std::vector<Scan> scans = wallScans(5, 4, 600);
  std::vector<Eigen::Isometry3d> bad;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      for (const double value : {static_cast<double>(kNaN), static_cast<double>(kInf)}) {
        Eigen::Isometry3d pose = scans[0].T_W_S;
        pose.matrix()(row, column) = value;
        bad.push_back(pose);
      }
    }
  }
  const auto linear = [&](const Eigen::Matrix3d& m) {
    Eigen::Isometry3d pose = scans[0].T_W_S;
    pose.linear() = m;
    bad.push_back(pose);
  };
  linear(2 * Eigen::Matrix3d::Identity());
  linear(1.0001 * Eigen::Matrix3d::Identity());
  linear(Eigen::Matrix3d::Zero());
  linear(Eigen::Vector3d(1, 1, -1).asDiagonal().toDenseMatrix());  // a mirror
  linear((Eigen::Matrix3d() << 1, 0.01, 0, 0, 1, 0, 0, 0, 1).finished());
  AccessibilityField clean(armTool(), coarse()), soiled(armTool(), coarse());
  for (const Scan& scan : scans) {
    for (const Eigen::Isometry3d& pose : bad) {
      EXPECT_THROW(soiled.integrateScan(scan.points_S, pose), UnusableInput) << pose.matrix();
    }
    clean.integrateScan(scan.points_S, scan.T_W_S);
    soiled.integrateScan(scan.points_S, scan.T_W_S);
    clean.update();
    soiled.update();
  }
  expectSame(soiled.snapshot(), clean.snapshot());
  expectSameMap(soiled.volume(), clean.volume());
}

TEST(BadData, BadRaysAreRefusedOrCounted) {
  AccessibilityField field(armTool(), coarse());
  const double nan = static_cast<double>(kNaN);
  const std::vector<Eigen::Vector3d> points = {{1, 0, 0}, {nan, 0, 0}, {2, 0, 0}, {3, 0, 0}};
  EXPECT_THROW(field.integrateRays(points, std::vector<Eigen::Vector3d>{{nan, 0, 0}}), UnusableInput);
  EXPECT_THROW(field.integrateRays(points, std::vector<Eigen::Vector3d>(2, {0, 0, 0})), InvalidArgument);
  EXPECT_THROW(field.integrateRays(points, std::vector<Eigen::Vector3d>{}), InvalidArgument);
  EXPECT_EQ(field.volume().leafCount(), 0u);
  const std::vector<Eigen::Vector3d> origins = {{0, 0, 0}, {0, 0, 0}, {0, nan, 0}, {3, 0, 0}};
  const FrameStats stats = field.integrateRays(points, origins);
  EXPECT_EQ(stats.points_used, 1u);
  EXPECT_EQ(dropped(stats, DropReason::NonFinite), 2u);
  EXPECT_EQ(dropped(stats, DropReason::NoReturn), 1u);
}

TEST(BadData, NaNAndInfinityInAnyParameterAreRefusedByName) {
  struct Field {
    const char* name;
    std::function<double&(FieldParams&)> value;
    bool infinity_allowed = false;
  };
  const std::vector<Field> fields = {
      {"voxel_size_m", [](FieldParams& p) -> double& { return p.tsdf.voxel_size_m; }},
      {"truncation_distance_m", [](FieldParams& p) -> double& { return p.tsdf.truncation_distance_m; }},
      {"range_noise_m", [](FieldParams& p) -> double& { return p.tsdf.range_noise_m; }},
      {"min_range_m", [](FieldParams& p) -> double& { return p.tsdf.min_range_m; }},
      {"max_range_m", [](FieldParams& p) -> double& { return p.tsdf.max_range_m; }, true},
      {"cone_cos_min", [](FieldParams& p) -> double& { return p.tsdf.cone_cos_min; }},
      {"clamp_min_m", [](FieldParams& p) -> double& { return p.tsdf.clamp_min_m; }},
      {"cleared_radius_voxels", [](FieldParams& p) -> double& { return p.tsdf.cleared_radius_voxels; }},
      {"cleared_begin_tau", [](FieldParams& p) -> double& { return p.tsdf.cleared_begin_tau; }},
      {"cleared_end_tau", [](FieldParams& p) -> double& { return p.tsdf.cleared_end_tau; }},
      {"normal_cone_rad", [](FieldParams& p) -> double& { return p.approach.normal_cone_rad; }},
      {"observation_cos_min", [](FieldParams& p) -> double& { return p.approach.observation_cos_min; }},
      {"arm_tau", [](FieldParams& p) -> double& { return p.approach.arm_tau[0]; }},
      {"arm_tau", [](FieldParams& p) -> double& { return p.approach.arm_tau[1]; }},
      {"arm_tau", [](FieldParams& p) -> double& { return p.approach.arm_tau[2]; }},
      {"corridor_length_m", [](FieldParams& p) -> double& { return p.approach.corridor_length_m; }},
      {"collision_distance_m", [](FieldParams& p) -> double& { return p.scoring.collision_distance_m; }},
      {"self_exclusion_voxels", [](FieldParams& p) -> double& { return p.scoring.self_exclusion_voxels; }},
      {"confidence_half_weight", [](FieldParams& p) -> double& { return p.scoring.confidence_half_weight; }},
      {"confidence_min", [](FieldParams& p) -> double& { return p.scoring.confidence_min; }},
      {"changed_voxel_radius_voxels", [](FieldParams& p) -> double& { return p.update.changed_voxel_radius_voxels; }},
      {"requeue_motion_m", [](FieldParams& p) -> double& { return p.update.requeue_motion_m; }},
      {"stability_min", [](FieldParams& p) -> double& { return p.update.stability_min; }}};
  const double inf = std::numeric_limits<double>::infinity();
  for (const Field& field : fields) {
    for (const double value : {static_cast<double>(kNaN), inf, -inf, -1e30}) {
      if (value == inf && field.infinity_allowed) continue;
      FieldParams params = coarse();
      field.value(params) = value;
      try {
        static_cast<void>(params.resolved());
        ADD_FAILURE() << field.name << " = " << value << " was accepted";
      } catch (const InvalidArgument& error) {
        EXPECT_EQ(error.subject(), field.name) << value;
        EXPECT_FALSE(error.id().empty());
      }
      EXPECT_THROW(AccessibilityField(armTool(), params), InvalidArgument) << field.name;
    }
  }
}

}  // namespace
}  // namespace accessvdb::test
