// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One small world for each outcome, through the public interface. A wall is at x = 2 m, voxels of 5 cm, tau 0.2 m;
/// the tested point is its middle (2, 0, 0). With four directions, only d = 2, towards -x, is in the normal's cone.
#include <gtest/gtest.h>

#include "accessvdb/accessibility_field.h"
#include "support/box_tool.h"

namespace accessvdb {
namespace {

using test::boxTool;

/// A rod extending 0.8 m backwards from the tip.
ToolGeometry rod() { return boxTool({0, -0.04f, -0.04f}, {0.8f, 0.04f, 0.04f}); }

FieldParams paramsOf(int num_directions) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.tsdf.range_noise_m = 0;
  params.approach.num_directions = num_directions;
  return params;
}

using Points = std::vector<Eigen::Vector3d>;

/// Returns on a plate at x, two per voxel.
Points plate(double x, double half_y, double half_z) {
  Points points;
  for (double y = -half_y; y <= half_y + 1e-9; y += 0.025) {
    for (double z = -half_z; z <= half_z + 1e-9; z += 0.025) points.emplace_back(x, y, z);
  }
  return points;
}

void look(AccessibilityField& field, const Points& points, const Eigen::Vector3d& sensor) {
  const Points origins = {sensor};
  field.integrateRays(points, origins);
}

/// The point at (2, 0, 0), the same from the snapshot and from the look-up.
SurfacePoint middle(AccessibilityField& field) {
  field.update();
  const auto point = field.pointAt({2, 0, 0});
  if (!point) {
    ADD_FAILURE() << "no point";
    return {};
  }
  const SurfacePoint same = field.snapshot().points.at(point->id);
  EXPECT_EQ(same.label, point->label);
  EXPECT_EQ(same.reason, point->reason);
  EXPECT_EQ(same.direction, point->direction);
  EXPECT_EQ(same.score, point->score);
  EXPECT_EQ(same.position_W, point->position_W);
  return *point;
}

void expectOutcome(const SurfacePoint& point, PointLabel label, PointReason reason, int direction) {
  EXPECT_STREQ(name(point.label), name(label));
  EXPECT_STREQ(name(point.reason), name(reason));
  EXPECT_EQ(point.direction, direction);
}

TEST(ReasonScenes, AFreeWallIsAccessibleAlongItsNormal) {
  for (const int num_directions : {4, 36, 180}) {
    AccessibilityField field(rod(), paramsOf(num_directions));
    look(field, plate(2, 0.5, 0.5), {0, 0, 0});
    const SurfacePoint point = middle(field);
    expectOutcome(point, PointLabel::Accessible, PointReason::None, num_directions / 2);
    EXPECT_EQ(point.score, 0);
    EXPECT_LT((point.normal_W - Eigen::Vector3f(-1, 0, 0)).norm(), 1e-6f);
    EXPECT_LT((point.direction_W - Eigen::Vector3f(-1, 0, 0)).norm(), 1e-6f);
    EXPECT_NEAR(point.yaw_rad, 3.14159265, 1e-6);
    EXPECT_GT(point.weight, 2);
    EXPECT_FLOAT_EQ(point.confidence, point.weight / (point.weight + 5));
    EXPECT_FLOAT_EQ(point.stability, 1);
  }
}

/// A ceiling over the foreground: the rod passes, a tool that is tall behind its tip does not.
TEST(ReasonScenes, ACeilingBlocksATallTool) {
  const ToolGeometry tall = boxTool({0.2f, -0.1f, 0.0f}, {0.8f, 0.1f, 0.6f});
  Points ceiling;
  for (double x = 1; x <= 1.8; x += 0.025) {
    for (double y = -1; y <= 1; y += 0.025) ceiling.emplace_back(x, y, 0.4);
  }
  for (const bool with_rod : {true, false}) {
    AccessibilityField field(with_rod ? rod() : tall, paramsOf(4));
    look(field, plate(2, 0.5, 0.2), {0, 0, 0});
    look(field, ceiling, {0, 0, 0});
    const SurfacePoint point = middle(field);
    if (with_rod) {
      expectOutcome(point, PointLabel::Accessible, PointReason::None, 2);
    } else {
      expectOutcome(point, PointLabel::Blocked, PointReason::Tool, 2);
      EXPECT_GE(point.score, field.collisionLimit());
      EXPECT_NE(point.score, kNoScore);
    }
  }
}

/// The tall tool again, with all directions and a ceiling on one side only (y > 0): it comes in from the other side.
TEST(ReasonScenes, TheBestDirectionAvoidsTheObstacle) {
  FieldParams params = paramsOf(36);
  params.scoring.max_collisions = 1;
  AccessibilityField field(boxTool({0.3f, -0.03f, 0.2f}, {0.8f, 0.03f, 0.6f}), params);
  Points obstacle;
  for (double x = 1; x <= 1.8; x += 0.025) {
    for (double y = -0.05; y <= 1; y += 0.025) obstacle.emplace_back(x, y, 0.4);
  }
  look(field, plate(2, 0.5, 0.2), {0, 0, 0});
  look(field, obstacle, {0, 0, -0.4});
  const SurfacePoint point = middle(field);
  EXPECT_STREQ(name(point.label), "accessible");
  // Outwards means towards -x; away from the obstacle is -y: past 18 (180 degrees).
  EXPECT_GT(point.direction, 18);
  EXPECT_LT(point.direction, 26);
}

/// A plate in the corridor, 0.45 m = 2.25 tau in front of the wall.
TEST(ReasonScenes, APlateInTheCorridorBlocksTheArm) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, plate(2, 0.5, 0.5), {0, 0, 0});
  look(field, plate(1.55, 0.3, 0.3), {0, 0, 0});
  const SurfacePoint point = middle(field);
  expectOutcome(point, PointLabel::Blocked, PointReason::Arm, 2);
  EXPECT_EQ(point.score, kNoScore);
}

/// A narrow wall seen from 60 degrees to the side: nothing was ever observed along the corridor.
TEST(ReasonScenes, UnknownSpaceInTheCorridorBlocks) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, plate(2, 0.1, 0.1), {2 - 1.0, -1.7320508, 0});
  expectOutcome(middle(field), PointLabel::Blocked, PointReason::Unknown, 2);
}

/// Seen from high above: no horizontal direction was ever observed.
TEST(ReasonScenes, AWallSeenFromAboveIsUnseen) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, plate(2, 0.5, 0.5), {1.6, 0, 5});
  expectOutcome(middle(field), PointLabel::Blocked, PointReason::Unseen, kNoDirection);
}

TEST(ReasonScenes, TheGroundHasNoDirectionInItsCone) {
  AccessibilityField field(rod(), paramsOf(180));
  Points ground;
  for (double x = 1.5; x <= 2.5; x += 0.025) {
    for (double y = -0.5; y <= 0.5; y += 0.025) ground.emplace_back(x, y, 0.0);
  }
  look(field, ground, {0, 0, 1.5});
  const SurfacePoint point = middle(field);
  expectOutcome(point, PointLabel::Blocked, PointReason::Normal, kNoDirection);
  EXPECT_LT((point.normal_W - Eigen::Vector3f(0, 0, 1)).norm(), 1e-6f);
}

/// One return is below c = 0.2 (1/6), two are above (2/7) but one point has no normal.
TEST(ReasonScenes, TooFewObservations) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, {{2, 0, 0}}, {0, 0, 0});
  SurfacePoint point = middle(field);
  expectOutcome(point, PointLabel::Unscored, PointReason::Confidence, kNoDirection);
  EXPECT_FLOAT_EQ(point.weight, 1);
  look(field, {{2, 0, 0}}, {0, 0, 0});
  point = middle(field);
  expectOutcome(point, PointLabel::Unscored, PointReason::Normal, kNoDirection);
  EXPECT_FLOAT_EQ(point.weight, 2);
  look(field, plate(2, 0.5, 0.5), {0, 0, 0});  // and with a wall around it, it is accessible
  expectOutcome(middle(field), PointLabel::Accessible, PointReason::None, 2);
}

/// What was accessible is blocked by a later obstacle.
TEST(ReasonScenes, LabelsFollowTheMap) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, plate(2, 0.5, 0.5), {0, 0, 0});
  expectOutcome(middle(field), PointLabel::Accessible, PointReason::None, 2);
  look(field, plate(1.55, 0.3, 0.3), {0, 0, 0});
  SurfacePoint point = middle(field);
  expectOutcome(point, PointLabel::Blocked, PointReason::Arm, 2);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);
  EXPECT_FALSE(point.confident);
}

/// Seen often enough (w / (w + 5) > 0.7 from w = 12 on) and accessible.
TEST(ReasonScenes, ConfidentNeedsConfidenceTimesStability) {
  AccessibilityField field(rod(), paramsOf(4));
  Points sparse;
  for (double y = -0.5; y < 0.55; y += 0.1) {
    for (double z = -0.5; z < 0.55; z += 0.1) sparse.emplace_back(2, y, z);
  }
  int unsure = 0, sure = 0;
  for (int looks = 0; looks < 15; ++looks) {
    look(field, sparse, {0, 0, 0});
    field.update();
    for (const SurfacePoint& point : field.snapshot().points) {
      const bool accessible = point.label == PointLabel::Accessible;
      ASSERT_EQ(point.confident, accessible && point.weight >= 12) << "weight " << point.weight;
      ++(point.confident ? sure : unsure);
    }
  }
  EXPECT_GT(unsure, 100);
  EXPECT_GT(sure, 100);
}

TEST(ReasonScenes, NewPointsAreUnscoredUntilTheUpdate) {
  AccessibilityField field(rod(), paramsOf(4));
  look(field, plate(2, 0.5, 0.5), {0, 0, 0});
  const auto point = field.pointAt({2, 0, 0});
  ASSERT_TRUE(point.has_value());
  EXPECT_EQ(point->label, PointLabel::Unscored);
  EXPECT_EQ(field.snapshot().count(PointLabel::Unscored), field.snapshot().points.size());
  EXPECT_FALSE(field.pointAt({1, 0, 0}).has_value());
  field.update();
  EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 100u);
}

}  // namespace
}  // namespace accessvdb
