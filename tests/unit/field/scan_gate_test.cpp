// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/scan_gate.h"

#include <gtest/gtest.h>

#include <cmath>

namespace accessvdb::internal {
namespace {

TsdfParams tsdf(double voxel_size_m) {
  TsdfParams params;
  params.voxel_size_m = voxel_size_m;
  params.truncation_distance_m = 4 * voxel_size_m;
  return params;
}

Eigen::Isometry3d poseAt(const Eigen::Vector3d& t) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = t;
  return pose;
}

TEST(ScanGate, TheOriginIsTheFirstSensorRoundedToVoxels) {
  ScanGate gate(tsdf(0.05));
  FrameStats stats;
  const std::vector<Eigen::Vector3f> points = {{1, 0, 0}};
  const GatedScan first = gate.gate(points, poseAt({500000.03, -5600000.01, 300.06}), stats);
  EXPECT_NEAR(gate.origin_W().x(), 500000.05, 1e-8);
  EXPECT_NEAR(gate.origin_W().y(), -5600000.0, 1e-8);
  EXPECT_NEAR(gate.origin_W().z(), 300.05, 1e-8);
  const Eigen::Vector3d origin = gate.origin_W();
  ASSERT_EQ(first.q_L.size(), 1u);
  EXPECT_NEAR(first.q_L[0].x(), -0.02, 1e-6);
  gate.gate(points, poseAt({7, 8, 9}), stats);
  EXPECT_EQ(gate.origin_W(), origin);
}

TEST(ScanGate, LocalPositionsAreRotatedShiftedReturns) {
  ScanGate gate(tsdf(0.05));
  FrameStats stats;
  gate.gate(std::vector<Eigen::Vector3f>{{1, 0, 0}}, poseAt({0, 0, 0}), stats);
  Eigen::Isometry3d pose = poseAt({2, 3, 1});
  pose.linear() = Eigen::AngleAxisd(std::acos(0.0), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const GatedScan scan = gate.gate(std::vector<Eigen::Vector3f>{{1, 0.5f, 0.25f}}, pose, stats);
  ASSERT_EQ(scan.p_L.size(), 1u);
  EXPECT_LT((scan.p_L[0] - Eigen::Vector3f(1.5f, 4, 1.25f)).norm(), 1e-6f);
  EXPECT_EQ(scan.q_L[0], Eigen::Vector3f(2, 3, 1));
}

TEST(ScanGate, RaysBecomeMultiplesOfTheStep) {
  ScanGate gate(tsdf(0.05));
  FrameStats stats;
  const std::vector<Eigen::Vector3d> p = {{1.00000013, 2.2222222222, -3.3333333333}}, q = {{0.1234567, 0, 0}};
  const GatedScan scan = gate.gate(p, q, stats);
  for (int a = 0; a < 3; ++a) {
    EXPECT_EQ(std::remainder(static_cast<double>(scan.p_L[0][a]), 0x1p-20), 0);
    EXPECT_NEAR(static_cast<double>(scan.p_L[0][a]) + gate.origin_W()[a], p[0][a], 0x1p-21 * 1.001);
  }
}

TEST(ScanGate, BoundsAreAMillionVoxelsAround) {
  ScanGate gate(tsdf(0.01));
  FrameStats stats;
  const std::vector<Eigen::Vector3f> points = {{9999, 0, 0}, {0, -9999, 0}, {10001, 0, 0}, {0, 0, -10001}};
  EXPECT_EQ(gate.gate(points, poseAt({0, 0, 0}), stats).p_L.size(), 2u);
  EXPECT_EQ(stats.points_used, 2u);
  EXPECT_EQ(stats.dropped[static_cast<std::size_t>(DropReason::OutOfBounds)], 2u);
  // A sensor out of bounds invalidates its whole scan.
  EXPECT_TRUE(gate.gate(points, poseAt({10500, 0, 0}), stats).p_L.empty());
  EXPECT_EQ(stats.points_in, 8u);
  EXPECT_EQ(stats.points_used, 2u);
}

TEST(ScanGate, RaysShorterThanTheirRoundingAreNoReturns) {
  ScanGate gate(tsdf(0.01));
  FrameStats stats;
  const std::vector<Eigen::Vector3f> points = {{1e-20f, 0, 0}, {0, 1e-38f, 0}};
  gate.gate(points, poseAt({0, 0, 0}), stats);
  stats = {};
  EXPECT_TRUE(gate.gate(points, poseAt({1, 1, 1}), stats).p_L.empty());
  EXPECT_EQ(stats.dropped[static_cast<std::size_t>(DropReason::NoReturn)], 2u);
}

}  // namespace
}  // namespace accessvdb::internal
