// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The projective baseline goes through the same stages as the method: its reported flips keep the mirror and
/// the exact policy correct, so that labels after every update are those of a full evaluation.
#include <gtest/gtest.h>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

class ProjectiveStream : public testing::TestWithParam<int> {};

TEST_P(ProjectiveStream, EqualsFromScratchAfterEveryUpdate) {
  const int variant = GetParam();
  test::WalkOptions walk_options;
  walk_options.frames = 5;
  walk_options.rays_per_frame = 2000;
  walk_options.seed = 21;
  walk_options.range_noise_m = 0.01;
  walk_options.max_range_m = 8;
  walk_options.length_m = 4;
  const test::WalkGenerator walk(walk_options);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.tsdf.region = UpdateRegion::Projective;
  params.tsdf.projective.bin_rad = 0.02;  // few enough for 2 000 rays to fill many
  params.tsdf.projective.cleared_band = true;
  params.tsdf.projective.in_front = (variant & 1) != 0;
  params.tsdf.projective.guarded = (variant & 2) != 0;
  const Eigen::Vector3d sensor_W = walk.frame(0).T_W_S.translation();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    params.tsdf.projective.box_min_W_m[axis] = sensor_W[static_cast<Eigen::Index>(axis)] - 4;
    params.tsdf.projective.box_max_W_m[axis] = sensor_W[static_cast<Eigen::Index>(axis)] + 4;
  }
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  for (int frame = 0; frame < walk_options.frames; ++frame) {
    const auto scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
    const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
    ASSERT_EQ(now.points.size(), scratch.points.size());
    for (std::size_t n = 0; n < now.points.size(); ++n) {
      ASSERT_EQ(now.points[n].label, scratch.points[n].label) << "frame " << frame << " point " << n;
      if (now.points[n].label != PointLabel::Accessible) continue;
      ASSERT_EQ(now.points[n].direction, scratch.points[n].direction) << "frame " << frame << " point " << n;
      ASSERT_EQ(now.points[n].score, scratch.points[n].score) << "frame " << frame << " point " << n;
    }
  }
  EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 50u);  // otherwise the comparison would prove nothing
  EXPECT_GT(field.snapshot().count(PointLabel::Blocked), 50u);
}
INSTANTIATE_TEST_SUITE_P(Variants, ProjectiveStream, testing::Values(0, 3));

TEST(ProjectiveField, RefusesRayCloudsAndGoesOn) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.tsdf.region = UpdateRegion::Projective;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  const std::vector<Eigen::Vector3d> points_W = {{1, 0, 0}, {1, 0.1, 0}}, origins_W = {{0, 0, 0}};
  EXPECT_THROW(field.integrateRays(points_W, origins_W), InvalidArgument);
  const std::vector<Eigen::Vector3f> points_S = {{1, 0, 0}};
  EXPECT_EQ(field.integrateScan(points_S, Eigen::Isometry3d::Identity()).points_used, 1u);
}

TEST(ProjectiveField, NeedsABoxForWhatLiesInFront) {
  FieldParams params;
  params.tsdf.region = UpdateRegion::Projective;
  EXPECT_NO_THROW((void)params.resolved());
  params.tsdf.projective.in_front = true;
  EXPECT_THROW((void)params.resolved(), InvalidArgument);
  params.tsdf.projective.box_max_W_m = {1, 1, 1};
  EXPECT_NO_THROW((void)params.resolved());
  EXPECT_NE(params.resolved().describe().find("region projective"), std::string::npos);
  params.tsdf.projective.box_max_W_m = {1e4, 1e4, 1e4};
  EXPECT_THROW((void)params.resolved(), InvalidArgument);
  params.tsdf.projective.in_front = false;
  params.tsdf.projective.bin_rad = 0;
  EXPECT_THROW((void)params.resolved(), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb
