// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tool at any pose: against exact distances, against the field's own counts, and for what cannot be a pose.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/pose_query.h"
#include "accessvdb/tool_spec.h"
#include "property/ball_world.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

using namespace test::ball_world;

Eigen::Isometry3d evenlyBetween(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to, double t) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() =
      Eigen::Quaterniond(from.linear()).slerp(t, Eigen::Quaterniond(to.linear())).normalized().toRotationMatrix();
  T.translation() = (1 - t) * from.translation() + t * to.translation();
  return T;
}

TEST(PoseFits, AgreesWithExactDistances) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  AccessibilityField field = ballField(tool);
  const std::vector<Eigen::Vector3d> places = surfaceOf(tool, 0.02);
  Random random;
  std::vector<Eigen::Isometry3d> T_WT;
  for (int n = 0; n < 3000; ++n) T_WT.push_back(random.pose(kRadius_m - 0.05, kRadius_m + 0.5));
  const std::vector<FitAnswer> answers = field.poseQuery().fits(T_WT);
  const BatchQuery at = field.batchQuery();
  std::size_t free = 0, touching = 0, blocked = 0, with_room = 0, missed = 0;
  for (std::size_t n = 0; n < T_WT.size(); ++n) {
    ASSERT_TRUE(answers[n].valid);
    double room_m = 1;
    std::vector<Eigen::Vector3d> surface_W;
    for (const Eigen::Vector3d& p_T : places) {
      surface_W.push_back(T_WT[n] * p_T);
      room_m = std::min(room_m, (surface_W.back() - kCentre_W).norm() - kRadius_m);
    }
    if (answers[n].collision()) {
      ++blocked;
      with_room += room_m > 2 * kVoxel_m ? 1 : 0;
    } else {
      ++free;
      touching += room_m < -kVoxel_m ? 1 : 0;
    }
    if (n % 20 != 0) continue;
    // No voxel is missed that the tool is in.
    std::vector<PointAnswer> voxels(surface_W.size());
    at.at(surface_W, voxels);
    bool unknown = false;
    for (const PointAnswer& voxel : voxels) unknown = unknown || voxel.unknown;
    missed += unknown && !answers[n].unknown() ? 1 : 0;
  }
  EXPECT_GT(free, 500U);
  EXPECT_GT(blocked, 500U);
  EXPECT_EQ(touching, 0U);
  EXPECT_LE(with_room, blocked / 100);
  EXPECT_EQ(missed, 0U);
}

/// The least room at which a plate still collides, whichever way it is turned, is below two voxels.
TEST(PoseFits, AgreesForAPlateAtEveryAngle) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  AccessibilityField field = ballField(tool);
  const std::vector<Eigen::Vector3d> places = surfaceOf(tool, 0.004);
  Random random;
  const PoseQuery query = field.poseQuery();
  double most_room_m = -1, least_depth_m = 1;
  for (int n = 0; n < 300; ++n) {
    const Eigen::Vector3d normal = random.direction();
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(random.uniform(0, M_PI), random.direction()).toRotationMatrix();
    for (double away_m = 0.6; away_m > -0.3; away_m -= 0.1 * kVoxel_m) {
      T.translation() = kCentre_W + (kRadius_m + away_m) * normal;
      if (!query.fits({&T, 1})[0].collision()) continue;
      double room_m = 1;
      for (const Eigen::Vector3d& p_T : places) room_m = std::min(room_m, (T * p_T - kCentre_W).norm() - kRadius_m);
      most_room_m = std::max(most_room_m, room_m);
      least_depth_m = std::min(least_depth_m, room_m);
      break;
    }
  }
  EXPECT_LT(most_room_m, 2 * kVoxel_m);
  EXPECT_GT(least_depth_m, -0.5 * kVoxel_m);
}

test::WalkGenerator fitWalk() {
  test::WalkOptions options = test::shortWalk(12, 3000);
  options.range_noise_m = test::WalkOptions().range_noise_m;
  options.seed = 2;
  return test::WalkGenerator(options);
}

AccessibilityField walkField(std::vector<ToolSpec> tools, double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.backend = BackendKind::Cpu;
  params.approach.num_directions = 36;
  AccessibilityField field(std::move(tools), params);
  const auto frames = fitWalk();
  for (int n = 0; n < 12; ++n) {
    const auto scan = frames.frame(n);
    field.integrateScan(scan.points_S, scan.T_W_S);
  }
  field.update();
  return field;
}

TEST(PoseFits, InContactCountsWhatTheFieldCounts) {
  std::vector<ToolSpec> tools;
  tools.emplace_back(ToolGeometry::builtin("builtin:pencil"));
  tools.emplace_back(ToolGeometry::builtin("builtin:pruner"));
  tools.back().orientations = OrientationSet::parse("pitch:-30:30:30");
  tools.back().rolls = 3;
  const AccessibilityField field = walkField(tools, 0.05);
  const PoseQuery query = field.poseQuery();
  const std::vector<SurfacePoint> points = field.snapshot().points;
  std::size_t tested = 0, differ = 0, accessible = 0;
  for (std::size_t n = 0; n < points.size(); n += points.size() / 60) {
    for (std::size_t k = 0; k < 2; ++k) {
      const AccessMap map = *field.accessMap(points[n].position_W, k);
      for (const DirectionOutcome& outcome : map.directions) {
        if (outcome.score == kNoScore) continue;
        Eigen::Isometry3d T_WT = Eigen::Isometry3d::Identity();
        T_WT.translation() = points[n].position_W;
        T_WT.linear() = outcome.orientation_WT.cast<double>().toRotationMatrix();
        const FitAnswer answer = query.fits({&T_WT, 1}, {.tool = k, .contact = true})[0];
        ASSERT_TRUE(answer.valid);
        EXPECT_EQ(answer.collision_limit, static_cast<std::uint32_t>(map.collision_limit));
        ++tested;
        differ += answer.collisions != outcome.score ? 1 : 0;
        accessible += answer.collision() ? 0 : 1;
        if (outcome.reason == PointReason::None) {
          EXPECT_FALSE(answer.collision());
        }
      }
    }
  }
  EXPECT_GT(tested, 500U);
  EXPECT_GT(accessible, 20U);
  EXPECT_EQ(differ, 0U);
}

TEST(PoseFits, AlongAWayIsWhatItIsAtItsPoses) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  AccessibilityField field = ballField(tool);
  const PoseQuery query = field.poseQuery();
  Random random;
  std::size_t hits = 0, through = 0;
  for (int n = 0; n < 100; ++n) {
    const std::vector<Eigen::Isometry3d> ends = {random.pose(0.8, 1.2), random.pose(0.8, 1.2), random.pose(0.8, 1.2)};
    const PathFitAnswer answer = query.fitsAlong(ends);
    ASSERT_TRUE(answer.valid);
    // Twenty times as densely, with the same way to move.
    double first = std::numeric_limits<double>::quiet_NaN();
    std::vector<Eigen::Isometry3d> dense;
    constexpr int kSteps = 2000;
    for (int k = 0; k <= 2 * kSteps; ++k) {
      const std::size_t part = k < kSteps ? 0 : 1;
      const double t = static_cast<double>(k) / kSteps - static_cast<double>(part);
      Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
      T.linear() = Eigen::Quaterniond(ends[part].linear())
                       .slerp(t, Eigen::Quaterniond(ends[part + 1].linear()))
                       .toRotationMatrix();
      T.translation() = (1 - t) * ends[part].translation() + t * ends[part + 1].translation();
      dense.push_back(T);
    }
    const std::vector<FitAnswer> all = query.fits(dense);
    for (int k = 0; k <= 2 * kSteps && std::isnan(first); ++k)
      if (all[static_cast<std::size_t>(k)].collision()) first = static_cast<double>(k) / kSteps;
    if (answer.collision) {
      ++hits;
      EXPECT_LE(first, answer.first_hit + 1e-3);
      EXPECT_NEAR(first, answer.first_hit, 0.05);
    } else {
      // Less than half a voxel may be cut off between two tries.
      through += std::isnan(first) ? 1 : 0;
    }
  }
  EXPECT_GT(hits, 20U);
  EXPECT_GT(through, 20U);
  Eigen::Isometry3d far = random.pose(1, 1.2);
  far.translation().x() += 1e5;
  const std::vector<Eigen::Isometry3d> endless = {random.pose(1, 1.2), far};
  EXPECT_FALSE(query.fitsAlong(endless).valid);
  EXPECT_FALSE(query.fitsAlong({}).valid);
  EXPECT_FALSE(query.fitsAlong({}).free());
}

TEST(PoseFits, UnknownSpaceEndsAWayWhereItIs) {
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
  AccessibilityField field = ballField(tool);
  const PoseQuery query = field.poseQuery();
  Random random;
  std::size_t by_unknown = 0, by_collision = 0, through = 0, nowhere = 0;
  for (int n = 0; n < 400; ++n) {
    const Eigen::Isometry3d from = random.pose(0.7, 1.5);
    Eigen::Isometry3d to = random.pose(0.7, 2.5);
    if (n % 3 == 0) to = evenlyBetween(from, to, 0.2);
    const std::vector<Eigen::Isometry3d> ends = {from, to};
    const PathFitAnswer answer = query.fitsAlong(ends, {.unknown_blocks = true});
    const PathFitAnswer plain = query.fitsAlong(ends);
    ASSERT_TRUE(answer.valid);
    EXPECT_EQ(answer.free(), plain.free());
    // Its own tries, one by one: where all is free up to fits_until, and not at the next.
    const Eigen::AngleAxisd turn(from.linear().transpose() * to.linear());
    const double moved_m = (to.translation() - from.translation()).norm() + std::abs(turn.angle()) * tool.reach_m();
    const int tries = std::max(1, static_cast<int>(std::ceil(2 * moved_m / kVoxel_m)));
    std::vector<Eigen::Isometry3d> poses;
    for (int k = 0; k <= tries; ++k) poses.push_back(k == tries ? to : evenlyBetween(from, to, double(k) / tries));
    const std::vector<FitAnswer> each = query.fits(poses);
    const auto ends_at = static_cast<int>(
        std::find_if(each.begin(), each.end(), [](const FitAnswer& a) { return !a.free(); }) - each.begin());
    if (ends_at == 0) {
      EXPECT_TRUE(std::isnan(answer.fits_until)) << n;
      ++nowhere;
    } else {
      EXPECT_NEAR(answer.fits_until, (ends_at - 1.0) / tries, 1e-12) << n;
    }
    if (ends_at > tries) {
      EXPECT_TRUE(answer.free()) << n;
      ++through;
      continue;
    }
    const FitAnswer& last = each[static_cast<std::size_t>(ends_at)];
    EXPECT_EQ(answer.collision, last.collision()) << n;
    EXPECT_EQ(answer.unknown, last.unknown()) << n;
    if (answer.collision) {
      EXPECT_NEAR(answer.first_hit, double(ends_at) / tries, 1e-12) << n;
    } else {
      EXPECT_TRUE(std::isnan(answer.first_hit)) << n;
    }
    ++(last.collision() ? by_collision : by_unknown);
  }
  EXPECT_GT(by_unknown, 10U);
  EXPECT_GT(by_collision, 10U);
  EXPECT_GT(through, 10U);
  EXPECT_GT(nowhere, 5U);
}

TEST(PoseFits, NoBadPoseIsFree) {
  const AccessibilityField field = walkField({ToolSpec(ToolGeometry::builtin("builtin:pencil"))}, 0.1);
  const PoseQuery query = field.poseQuery();
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  std::vector<Eigen::Isometry3d> bad(8, Eigen::Isometry3d::Identity());
  bad[0].translation().x() = kNan;
  bad[1].translation().y() = std::numeric_limits<double>::infinity();
  bad[2].translation().z() = 1e9;
  bad[3].linear()(0, 0) = kNan;
  bad[4].linear() *= 1.001;
  bad[5].linear().col(0) *= -1;  // a mirror image
  bad[6].linear()(0, 1) = 0.01;
  bad[7].linear().setZero();
  for (const bool contact : {false, true}) {
    for (const FitAnswer& answer : query.fits(bad, {.contact = contact})) {
      EXPECT_FALSE(answer.valid);
      EXPECT_FALSE(answer.free());
      EXPECT_TRUE(answer.collision() && answer.unknown());
    }
  }
  for (const Eigen::Isometry3d& pose : bad) EXPECT_FALSE(query.fitsAlong({&pose, 1}).free());
  Eigen::Isometry3d nowhere = Eigen::Isometry3d::Identity();
  nowhere.translation().setConstant(1000);
  const FitAnswer answer = query.fits({&nowhere, 1})[0];
  EXPECT_TRUE(answer.valid && answer.unknown() && !answer.collision() && !answer.free());
  EXPECT_THROW(static_cast<void>(query.fits(bad, {.tool = 1})), InvalidArgument);
  std::vector<FitAnswer> few(3);
  EXPECT_THROW(query.fits(bad, few), InvalidArgument);
}

TEST(PoseFits, AreOutOfDateWhenTheFieldChanges) {
  auto field =
      std::make_unique<AccessibilityField>(walkField({ToolSpec(ToolGeometry::builtin("builtin:pencil"))}, 0.1));
  const PoseQuery query = field->poseQuery();
  const Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  EXPECT_TRUE(query.current());
  const ToolFit own = field->hostView().fits(query.toolView(), pose.linear().eval().data(), pose.translation().data());
  const FitAnswer answer = query.fits({&pose, 1})[0];
  EXPECT_EQ(own.collisions, answer.collisions);
  EXPECT_EQ(own.unknown, answer.unknown_voxels);
  field->update();
  EXPECT_FALSE(query.current());
  EXPECT_THROW(static_cast<void>(query.fits({&pose, 1})), InvalidArgument);
  EXPECT_THROW(static_cast<void>(query.fitsAlong({&pose, 1})), InvalidArgument);
  const PoseQuery later = field->poseQuery();
  field.reset();
  EXPECT_THROW(static_cast<void>(later.fits({&pose, 1})), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb
