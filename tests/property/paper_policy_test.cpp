// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's update policy: each trigger and each rule of the queue in a scene in which the labels differ without it.
#include <gtest/gtest.h>

#include <algorithm>

#include "accessvdb/device_view.h"
#include "property/paper_stream.h"

namespace accessvdb::test {
namespace {

/// Ids of all points that were evaluated, ascending.
std::vector<std::uint32_t> evaluated(const AccessibilityField& field) {
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& p : field.snapshot().points) {
    if (p.label != PointLabel::Unscored) ids.push_back(p.id);
  }
  return ids;
}

/// A plate is first seen from above, so that the space in front of it is unknown; then it has moved back, and the rays
/// that now reach it clear that space. The points at its old place are not hit again.
class MovedPlate : public testing::Test {
 protected:
  static FieldParams params() {
    FieldParams p = quietParams();
    p.tsdf.max_weight = 4;       // a map that forgets: one scan outweighs the past
    p.tsdf.cleared_end_tau = 4;  // beyond the last corridor sample of the old place
    p.tsdf.cleared_radius_voxels = 1;
    return p;
  }
  static void play(Stream& stream, double moved_back_m) {
    stream.scanAndUpdate(plateAt(0), {0.3, 0, 1});
    ASSERT_EQ(stream.at(kMiddle).label, PointLabel::Blocked);
    ASSERT_EQ(stream.at(kMiddle).reason, PointReason::Unknown);
    stream.scanAndUpdate(plateAt(-moved_back_m), kFront);
    ASSERT_EQ(stream.labelFromScratch(kMiddle), PointLabel::Accessible);
  }
};

TEST_F(MovedPlate, DistanceTriggerFindsAJumpOfMoreThanTwoVoxels) {
  Stream far(params()), near(params());
  play(far, 3.75 * kVoxel_m);  // the distance at its voxel rises by about 2.6 v
  EXPECT_EQ(far.at(kMiddle).label, PointLabel::Accessible);
  play(near, 2.75 * kVoxel_m);  // 1.6 v
  EXPECT_EQ(near.at(kMiddle).label, PointLabel::Blocked);
}

TEST_F(MovedPlate, SampleTriggerFindsAChangedNeighbourhood) {
  FieldParams sampled = params();
  sampled.update.changed_voxel_sample = kEveryVoxel;
  Stream with(sampled), without(params());
  play(with, 1 * kVoxel_m);
  EXPECT_EQ(with.at(kMiddle).label, PointLabel::Accessible);
  play(without, 1 * kVoxel_m);
  EXPECT_EQ(without.at(kMiddle).label, PointLabel::Blocked);
}

/// A plate behind writes up to tau in front of it. Points within 3 v of the last voxel written are found, others are
/// not.
TEST_F(MovedPlate, SampleTriggerReachesThreeVoxels) {
  const auto dirtyBefore = [](double last_written_m) {
    FieldParams p = params();
    p.update.changed_voxel_sample = kEveryVoxel;
    Stream stream(p);
    stream.scanAndUpdate(plateAt(-0.005), kFront);
    const std::vector<Vector3d> behind = plateAt(last_written_m - 4 * kVoxel_m);
    return stream.scanAndUpdate(behind, kFront).dirty_points - behind.size();
  };
  EXPECT_EQ(dirtyBefore(-0.058), plateAt(0).size());  // voxel -3, 0.055 m away
  EXPECT_EQ(dirtyBefore(-0.062), 0u);                 // voxel -4, 0.075 m away
}

/// A return writes a slim double cone, or in the paper's definition the cube around it; the points beside it are 2.75 v
/// from the cube and more than 3 v from the cone.
TEST_F(MovedPlate, SampleTriggerLooksWhereTheReturnWrites) {
  for (const UpdateRegion region : {UpdateRegion::DoubleCone, UpdateRegion::FullCube}) {
    FieldParams p = params();
    p.tsdf.region = region;
    p.update.changed_voxel_sample = kEveryVoxel;
    Stream stream(p);
    const std::vector<Vector3d> beside = plate({0, 0.175, 0}, {0, 1, 0}, 0.04, 0.04);
    for (int n = 0; n < 3; ++n) stream.scanAndUpdate(beside, kFront);
    ASSERT_EQ(evaluated(stream.field()).size(), beside.size());
    const std::uint64_t found = stream.scanAndUpdate({kMiddle}, kFront).dirty_points;  // it is not confident itself
    EXPECT_EQ(found > 0, region == UpdateRegion::FullCube);
  }
}

/// From steeply above no horizontal direction is seen; a little forward, +x is.
class MovingSensor : public testing::Test {
 protected:
  static FieldParams params() {
    FieldParams p = quietParams();
    p.approach.arm_tau = {0.6, 0.7, 0.8};  // inside what the returns observe: nothing has to be cleared
    p.approach.viewpoints = false;         // stored viewpoints are 0.1 m apart
    p.update.requeue_motion_m = 0.1;
    return p;
  }
  static Vector3d sensor(double forward_m) { return {0.22 + forward_m, 0, 1}; }
};

TEST_F(MovingSensor, RequeuesWhatIsNotAccessible) {
  for (const double motion_m : {0.09, 0.11}) {
    Stream stream(params());
    stream.scanAndUpdate(plateAt(0), sensor(0));
    ASSERT_EQ(stream.at(kMiddle).reason, PointReason::Unseen);
    stream.scanAndUpdate(plateAt(0), sensor(motion_m));
    ASSERT_EQ(stream.labelFromScratch(kMiddle), PointLabel::Accessible);
    EXPECT_EQ(stream.at(kMiddle).label, motion_m > 0.1 ? PointLabel::Accessible : PointLabel::Blocked) << motion_m;
  }
}

TEST_F(MovingSensor, MotionCountsFromTheLastFiring) {
  Stream stream(params());
  stream.scanAndUpdate(plateAt(0), sensor(0));
  stream.scanAndUpdate(plateAt(0), sensor(0.06));
  EXPECT_EQ(stream.at(kMiddle).label, PointLabel::Blocked);
  stream.scanAndUpdate(plateAt(0), sensor(0.12));  // 0.06 from the last scan, 0.12 from the start
  EXPECT_EQ(stream.at(kMiddle).label, PointLabel::Accessible);
}

TEST_F(MovingSensor, LeavesAccessiblePointsAlone) {
  Stream stream(params());
  stream.scanAndUpdate(plateAt(0), kFront);
  const std::uint64_t blocked = stream.field().snapshot().count(PointLabel::Blocked);
  ASSERT_GT(stream.field().snapshot().count(PointLabel::Accessible), 50u);
  EXPECT_EQ(stream.scanAndUpdate(plateAt(0), kFront + Vector3d(0.2, 0, 0)).dirty_points, blocked);
}

std::vector<std::uint32_t> idsBelow(std::uint32_t end) {
  std::vector<std::uint32_t> ids;
  for (std::uint32_t id = 0; id < end; ++id) ids.push_back(id);
  return ids;
}

TEST(PaperQueue, BacklogIsWorkedOffBetweenScansInOrder) {
  FieldParams p = quietParams();
  p.update.budget_points = 20;
  Stream stream(p);
  const auto first = static_cast<std::uint32_t>(plateAt(0).size());
  ASSERT_EQ(first, 121u);
  EXPECT_EQ(stream.scanAndUpdate(plateAt(0), kFront).backlog, first - 20);
  EXPECT_EQ(evaluated(stream.field()), idsBelow(20));
  // Points that come now are queued after those that wait.
  std::vector<Vector3d> aside = plateAt(0);
  for (Vector3d& x : aside) x.y() += 1;
  EXPECT_EQ(stream.scanAndUpdate(aside, kFront).backlog, 2 * first - 40);
  EXPECT_EQ(evaluated(stream.field()), idsBelow(40));
  std::uint32_t done = 40;
  while (done < 2 * first) {
    done = std::min(done + 20, 2 * first);
    EXPECT_EQ(stream.field().update().backlog, 2 * first - done);
    EXPECT_EQ(evaluated(stream.field()), idsBelow(done));
  }
  EXPECT_EQ(stream.field().update().dirty_points, 0u);
}

TEST(PaperQueue, APointWaitsOnce) {
  FieldParams p = quietParams();
  p.update.budget_points = 1;
  p.update.requeue_motion_m = 0.1;
  p.update.changed_voxel_sample = kEveryVoxel;
  Stream stream(p);
  for (int n = 0; n < 4; ++n) stream.scan(plateAt(0), kFront + Vector3d(0.2 * n, 0, 0));
  EXPECT_EQ(stream.field().update().backlog, 120u);
}

/// Returns farther apart than tau: each voxel of a return has the number of scans as its weight.
std::vector<Vector3d> sparsePlate() { return plate(kMiddle, {0, 1, 0}, 0.2, 0.2, 0.1); }

TEST(PaperQueue, PointsBelowTheConfidenceBoundDoNotWait) {
  Stream stream(quietParams());
  const std::uint64_t count = sparsePlate().size();
  const auto expectUntouched = [&](const UpdateStats& stats) {
    EXPECT_EQ(stats.dirty_points, 0u);
    EXPECT_EQ(stats.direction_tests, 0u);
    EXPECT_EQ(stats.backlog, 0u);
    const SurfacePoint p = stream.at(kMiddle);
    EXPECT_EQ(p.label, PointLabel::Unscored);
    EXPECT_EQ(p.reason, PointReason::Confidence);
    EXPECT_EQ(p.score, kNoScore);
    EXPECT_EQ(p.stability, 1.0f);
  };
  expectUntouched(stream.scanAndUpdate(sparsePlate(), kFront));
  expectUntouched(stream.field().update());
  expectUntouched(stream.scanAndUpdate({{0, 3, 0}}, kFront));  // elsewhere
  // Seen again: c = 2/7. No trigger is active.
  EXPECT_EQ(stream.scanAndUpdate(sparsePlate(), kFront).dirty_points, count);
  EXPECT_FLOAT_EQ(stream.at(kMiddle).confidence, 2.0f / 7.0f);
  EXPECT_NE(stream.at(kMiddle).label, PointLabel::Unscored);
  EXPECT_EQ(stream.scanAndUpdate(sparsePlate(), kFront).dirty_points, 0u);
}

/// Triggers do not add them either.
TEST(PaperQueue, TriggersLeavePointsBelowTheConfidenceBoundAlone) {
  FieldParams p = quietParams();
  p.update.changed_voxel_sample = kEveryVoxel;
  p.update.requeue_motion_m = 0.1;
  Stream stream(p);
  stream.scan(sparsePlate(), kFront);
  const UpdateStats stats = stream.scanAndUpdate({{0, 3, 0}}, kFront + Vector3d(0.5, 0, 0));
  EXPECT_EQ(stats.dirty_points, 0u);
  EXPECT_EQ(stats.backlog, 0u);
}

TEST(PaperQueue, ViewsShowTheWeightsOfPointsThatWereSeenAgain) {
  Stream stream(quietParams());
  for (int n = 0; n < 6; ++n) stream.scanAndUpdate(sparsePlate(), kFront);
  const SurfacePoint p = stream.at(kMiddle);
  EXPECT_EQ(p.weight, 6u);
  const DeviceView view = stream.field().hostView();
  EXPECT_EQ(view.points.weight[p.id], p.weight);
}

TEST(PaperQueue, PointsBelowTheConfidenceBoundCostNoBudget) {
  FieldParams p = quietParams();
  p.update.budget_points = 10;
  Stream stream(p);
  stream.scan(sparsePlate(), kFront);
  std::vector<Vector3d> aside = plateAt(0);
  for (Vector3d& x : aside) x.y() += 1;
  const UpdateStats stats = stream.scanAndUpdate(aside, kFront);
  EXPECT_EQ(evaluated(stream.field()).size(), 10u);
  EXPECT_EQ(stats.backlog, aside.size() - 10);
}

}  // namespace
}  // namespace accessvdb::test
