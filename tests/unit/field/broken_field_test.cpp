// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A step that fails half-way must not leave a field that answers: a mirror that lacks an obstacle would call points
/// accessible.
#include <gtest/gtest.h>

#include <random>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"

namespace accessvdb {
namespace {

std::string idOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.id();
  }
  return "no error";
}

TEST(BrokenField, AnswersNothingAfterAStepFailedHalfWay) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  // Returns all over the admitted space: more root tiles (of 4096 voxels a side) than the mirror has room for.
  std::mt19937_64 random(1);
  std::vector<Eigen::Vector3d> points, origins;
  for (int n = 0; n < 6000; ++n) {
    const auto coordinate = [&] { return (static_cast<double>(random() >> 11) * 0x1.0p-53 - 0.5) * 1.8e6 * 0.05; };
    points.emplace_back(coordinate(), coordinate(), coordinate());
    origins.push_back(points.back() + Eigen::Vector3d(0, 0, 2));
  }
  origins.front() = Eigen::Vector3d::Zero();
  points.front() = Eigen::Vector3d(0, 0, 1);
  EXPECT_EQ(idOf([&] { field.integrateRays(points, origins); }), "map.root_tiles");

  const Eigen::Vector3f point_S(1, 0, 0);
  EXPECT_EQ(idOf([&] { field.integrateScan({&point_S, 1}, Eigen::Isometry3d::Identity()); }), "field.broken");
  EXPECT_EQ(idOf([&] { field.update(); }), "field.broken");
  EXPECT_EQ(idOf([&] { static_cast<void>(field.snapshot()); }), "field.broken");
  EXPECT_EQ(idOf([&] { static_cast<void>(field.evaluateFromScratch()); }), "field.broken");
  EXPECT_EQ(idOf([&] { static_cast<void>(field.pointAt({0, 0, 1})); }), "field.broken");
}

TEST(BrokenField, ABadPoseBreaksNothing) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), {});
  Eigen::Isometry3d bad = Eigen::Isometry3d::Identity();
  bad.translation().x() = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Vector3f point_S(1, 0, 0);
  EXPECT_EQ(idOf([&] { field.integrateScan({&point_S, 1}, bad); }), "pose.not_rigid");
  EXPECT_EQ(field.integrateScan({&point_S, 1}, Eigen::Isometry3d::Identity()).points_used, 1u);
  field.update();
  EXPECT_EQ(field.snapshot().points.size(), 1u);
}

TEST(LocalOrigin, IsNotPlacedByAGarbageRay) {
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), {});
  const std::vector<Eigen::Vector3d> points = {{1, 0, 0}, {5, 0, 0}}, origins = {{1e30, 0, 0}, {3, 0, 0}};
  const FrameStats stats = field.integrateRays(points, origins);
  EXPECT_EQ(stats.points_used, 1u);
  EXPECT_EQ(field.origin_W(), Eigen::Vector3d(3, 0, 0));
}

}  // namespace
}  // namespace accessvdb
