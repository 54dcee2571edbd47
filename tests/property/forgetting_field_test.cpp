// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Free space ages and what has gone opens, as a field shows it: exact updates, saved states, threads, stamps of every
/// kind, queries, and what is refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/tsdf_volume.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {
namespace {

constexpr double kVoxel_m = 0.04, kForever_s = std::numeric_limits<double>::infinity();

/// ACCESSVDB_CHANGE_DEVICE=cuda: fields are on the GPU, but for those whose mirror is read on the host.
BackendKind backend() { return backendNamedBy("ACCESSVDB_CHANGE_DEVICE"); }

FieldParams paramsOf(double free_for_s) {
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.range_noise_m = 0.01;
  params.change = {ChangeMode::Full, free_for_s};
  params.backend = backend();
  params.threads = 2;
  params.approach.num_directions = 36;
  return params;
}

constexpr int kScans = 60;
Eigen::Isometry3d poseAt(int scan) {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  T_W_S.translation() = Eigen::Vector3d(0.02 * std::sin(scan), 0.3 * std::sin(0.7 * scan), 0.2 * std::cos(0.9 * scan));
  return T_W_S;
}
/// A post stands 0.8 m before a wall in scans 8 .. 19 and 40 .. 43.
bool postAt(int scan) { return (scan >= 8 && scan < 20) || (scan >= 40 && scan < 44); }
bool isPost(const Eigen::Vector3d& p_W) { return p_W.x() < 1.5; }
std::vector<Eigen::Vector3f> wallAndPost(int scan) {
  std::mt19937_64 random(static_cast<std::uint64_t>(scan) + 500);
  const Eigen::Vector3d sensor = poseAt(scan).translation();
  // The sensor turns away now and then: what it does not see ages.
  const double side = scan % 20 < 10 ? 0.8 : -0.1;
  std::vector<Eigen::Vector3f> points_S;
  for (int n = 0; n < 2500; ++n) {
    const Eigen::Vector3d at(2, uniform(random, -0.8, side), uniform(random, -0.5, 0.5));
    const double share = (1.2 - sensor.x()) / (at.x() - sensor.x());
    const Eigen::Vector3d at_post = sensor + share * (at - sensor);
    const bool hits = postAt(scan) && std::abs(at_post.y() + 0.2) < 0.15;
    const Eigen::Vector3d p = sensor + (hits ? share : 1) * (1 + uniform(random, -0.002, 0.002)) * (at - sensor);
    points_S.push_back((p - sensor).cast<float>());
  }
  return points_S;
}
double regularStamp(int scan) { return 1000 + 0.1 * scan; }

using Stamps = std::function<double(int)>;
void fuse(AccessibilityField& field, int from, int to, const Stamps& stamp_s = regularStamp) {
  for (int scan = from; scan < to; ++scan) field.integrateScan(wallAndPost(scan), poseAt(scan), stamp_s(scan));
}

TEST(ForgettingField, ExactUpdatesAreThoseFromScratch) {
  for (const int every : {1, 7}) {
    AccessibilityField field(armTool(), paramsOf(1.5));
    std::size_t gone = 0;
    for (int scan = 0; scan < kScans; ++scan) {
      fuse(field, scan, scan + 1);
      if ((scan + 1) % every != 0) continue;
      field.update();
      const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
      for (std::size_t n = 0; n < now.points.size(); ++n) {
        ASSERT_EQ(now.points[n].label, scratch.points[n].label) << "scan " << scan << " point " << n;
        ASSERT_EQ(now.points[n].weight, scratch.points[n].weight);
        gone += now.points[n].reason == PointReason::Changed ? 1 : 0;
        if (now.points[n].label != PointLabel::Accessible) continue;
        ASSERT_EQ(now.points[n].score, scratch.points[n].score);
        ASSERT_EQ(now.points[n].direction, scratch.points[n].direction);
      }
    }
    EXPECT_GT(gone, 100u);
  }
}

TEST(ForgettingField, ASavedStateGoesOnAsIfThereHadBeenNoStop) {
  const ScratchFolder folder;
  // Between hits and verdicts, between verdict and opening, with open voxels, after the post came back, at a turn.
  for (const int stop : {10, 22, 23, 24, 27, 33, 41, 45, 58}) {
    SCOPED_TRACE(stop);
    FieldParams params = paramsOf(1.5);
    params.mirror_distance = true;
    AccessibilityField straight(armTool(), params);
    fuse(straight, 0, stop);
    straight.update();
    straight.saveState(folder / "a.avst");
    AccessibilityField loaded = AccessibilityField::loadState(folder / "a.avst", armTool(), backend(), 1);
    EXPECT_EQ(loaded.params().change.mode, ChangeMode::Full);
    EXPECT_EQ(loaded.params().change.free_for_s, 1.5);
    loaded.saveState(folder / "b.avst");
    EXPECT_EQ(inspectState(folder / "a.avst").sha256, inspectState(folder / "b.avst").sha256) << "loading ages nothing";
    expectSame(straight.snapshot(), loaded.snapshot());
    fuse(straight, stop, kScans);
    fuse(loaded, stop, kScans);
    straight.update();
    loaded.update();
    expectSame(straight.snapshot(), loaded.snapshot());
    straight.saveState(folder / "a.avst");
    loaded.saveState(folder / "b.avst");
    std::ifstream a(folder / "a.avst", std::ios::binary), b(folder / "b.avst", std::ios::binary);
    const std::string of_a((std::istreambuf_iterator<char>(a)), {}), of_b((std::istreambuf_iterator<char>(b)), {});
    EXPECT_GT(of_a.size(), 100000u);
    if (of_a.size() != of_b.size()) ADD_FAILURE() << "other sizes";
    // Leaves are in the tree's order, which is by place: the files are equal to the last byte.
    EXPECT_TRUE(of_a == of_b);
  }
}

TEST(ForgettingField, ThreadsDoNotMatter) {
  const ScratchFolder folder;
  for (const int threads : {1, 2}) {
    FieldParams params = paramsOf(1.5);
    params.threads = threads;
    AccessibilityField field(armTool(), params);
    fuse(field, 0, kScans);
    field.saveState(folder / (threads == 1 ? "a.avst" : "b.avst"));
  }
  std::ifstream a(folder / "a.avst", std::ios::binary), b(folder / "b.avst", std::ios::binary);
  const std::string of_a((std::istreambuf_iterator<char>(a)), {}), of_b((std::istreambuf_iterator<char>(b)), {});
  EXPECT_TRUE(of_a == of_b);
}

/// At every moment, whatever the stamps are: ageing only takes accessibility away. Stamps that say nothing age nothing.
TEST(ForgettingField, AgeingMakesNoPointAccessible) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const struct {
    const char* name;
    Stamps stamp_s;
    bool ages;
  } kinds[] = {{"regular", regularStamp, true},
               {"equal", [](int) { return 7.0; }, false},
               {"missing", [=](int) { return nan; }, false},
               {"infinite", [](int scan) { return scan % 2 == 0 ? kForever_s : -kForever_s; }, false},
               {"reversed", [](int scan) { return 100.0 - scan; }, false},
               {"some missing", [=](int scan) { return scan % 3 == 0 ? regularStamp(scan) : nan; }, true},
               {"nanoseconds", [](int scan) { return 1e9 * regularStamp(scan); }, true}};
  AccessibilityField never(armTool(), paramsOf(kForever_s));
  std::vector<FieldSnapshot> without;
  for (int scan = 0; scan < kScans; ++scan) {
    fuse(never, scan, scan + 1);
    never.update();
    without.push_back(never.snapshot());
  }
  for (const auto& kind : kinds) {
    SCOPED_TRACE(kind.name);
    AccessibilityField field(armTool(), paramsOf(1.5));
    std::size_t taken = 0;
    for (int scan = 0; scan < kScans; ++scan) {
      fuse(field, scan, scan + 1, kind.stamp_s);
      field.update();
      const FieldSnapshot now = field.snapshot();
      ASSERT_EQ(now.points.size(), without[static_cast<std::size_t>(scan)].points.size());
      for (std::size_t n = 0; n < now.points.size(); ++n) {
        const SurfacePoint& other = without[static_cast<std::size_t>(scan)].points[n];
        if (now.points[n].label == other.label) continue;
        ASSERT_EQ(other.label, PointLabel::Accessible) << "scan " << scan;
        ++taken;
      }
    }
    EXPECT_EQ(taken > 0, kind.ages);
  }
}

/// Points of the post are `changed` after it left, everywhere; and no longer when it is back.
TEST(ForgettingField, PointsThatHaveGoneAreUnscored) {
  FieldParams params = paramsOf(kForever_s);
  params.backend = BackendKind::Cpu;
  AccessibilityField field(armTool(), params);
  const auto goneShare = [&](bool is_open) {
    field.update();
    const FieldSnapshot now = field.snapshot();
    const DeviceView view = field.hostView();
    const BatchQuery query = field.batchQuery();
    std::size_t of_post = 0, gone = 0;
    for (const SurfacePoint& point : now.points) {
      const bool is_gone = point.reason == PointReason::Changed;
      EXPECT_EQ(view.points.reason[point.id], point.reason);
      EXPECT_EQ(view.points.label[point.id], point.label);
      EXPECT_EQ(field.pointAt(point.position_W)->reason, point.reason);
      if (isPost(point.position_W)) {
        ++of_post;
        gone += is_gone ? 1 : 0;
      } else {
        EXPECT_FALSE(is_gone) << "the wall stands";
      }
      if (!is_gone) continue;
      EXPECT_EQ(point.label, PointLabel::Unscored);
      if (is_open) {
        EXPECT_FALSE(view.collides(point.position_W.data())) << "a point has gone when its own voxel is open";
        EXPECT_TRUE(view.armFree(point.position_W.data()));
      }
      std::vector<PointAnswer> answers(1);
      query.at(std::vector<Eigen::Vector3d>{point.position_W}, answers);
      EXPECT_EQ(answers[0].reason, PointReason::Changed);
      EXPECT_EQ(answers[0].label, PointLabel::Unscored);
    }
    return static_cast<double>(gone) / static_cast<double>(std::max<std::size_t>(of_post, 1));
  };
  fuse(field, 0, 20);
  EXPECT_EQ(goneShare(true), 0);
  fuse(field, 20, 40);
  const double before = goneShare(true);
  EXPECT_GT(before, 0.6);
  fuse(field, 40, 44);
  // Returns beside it may make its voxel collide again before it gets one itself.
  EXPECT_LT(goneShare(false), 0.5 * before);
}

/// An improving flip needs a return whose region holds the voxel, or a ray through it.
TEST(ForgettingField, NothingImprovesWithoutARay) {
  FieldParams params = paramsOf(1.5);
  params.backend = BackendKind::Cpu;
  AccessibilityField field(armTool(), params);
  std::vector<Eigen::Vector3d> centres;
  std::vector<std::uint8_t> collided, free;
  std::size_t improved = 0, opened = 0;
  for (int scan = 0; scan < 48; ++scan) {
    const std::vector<Eigen::Vector3f> points_S = wallAndPost(scan);
    const Eigen::Vector3d sensor = poseAt(scan).translation();
    fuse(field, scan, scan + 1);
    const DeviceView view = field.hostView();
    const TsdfParams& t = field.params().tsdf;
    const double tau_m = t.truncation_distance_m;
    // The cleared band holds the centres within its radius; a ray through a voxel is within half a diagonal of its own.
    const double reach_m = kVoxel_m * (std::max(t.cleared_radius_voxels, 0.5 * std::sqrt(3.0)) + 0.01);
    if (centres.empty()) {
      for (double x = 0.4; x < 2.3; x += kVoxel_m) {
        for (double y = -0.9; y < 0.9; y += kVoxel_m) {
          for (double z = -0.6; z < 0.6; z += kVoxel_m) {
            // At the centre of a voxel.
            const Eigen::Vector3d relative = Eigen::Vector3d(x, y, z) - field.origin_W();
            centres.push_back(field.origin_W() + kVoxel_m * (relative / kVoxel_m).array().round().matrix());
          }
        }
      }
      collided.assign(centres.size(), 0);
      free.assign(centres.size(), 0);
    }
    for (std::size_t n = 0; n < centres.size(); ++n) {
      const std::uint8_t collides = view.collides(centres[n].data()), is_free = view.armFree(centres[n].data());
      if ((collided[n] != 0 && collides == 0) || (free[n] == 0 && is_free != 0)) {
        ++improved;
        opened += collided[n] != 0 && centres[n].x() < 1.4 ? 1 : 0;
        const bool has_ray = std::ranges::any_of(points_S, [&](const Eigen::Vector3f& p_S) {
          const Eigen::Vector3d p = p_S.cast<double>(), to = centres[n] - sensor;
          if ((p - to).lpNorm<Eigen::Infinity>() <= tau_m + kVoxel_m) return true;
          const double along = std::clamp(to.dot(p) / p.squaredNorm(), 0.0, 1.0);
          return (to - along * p).norm() <= reach_m;
        });
        ASSERT_TRUE(has_ray) << "scan " << scan << " at " << centres[n].transpose();
      }
      collided[n] = collides;
      free[n] = is_free;
    }
  }
  EXPECT_GT(improved, 1000u);
  EXPECT_GT(opened, 100u);
}

/// Time passes also while nothing returns: in the end nothing is accessible, and no arm is free.
TEST(ForgettingField, TimePassesWithoutReturns) {
  FieldParams params = paramsOf(1.5);
  params.backend = BackendKind::Cpu;
  AccessibilityField field(armTool(), params);
  fuse(field, 0, 8);
  field.update();
  EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 100u);
  const std::vector<Eigen::Vector3f> nothing(100, Eigen::Vector3f::Zero());
  for (int scan = 8; scan < 45; ++scan) {
    field.integrateScan(nothing, poseAt(scan), regularStamp(scan));
    field.update();
    const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
    for (std::size_t n = 0; n < now.points.size(); ++n) ASSERT_EQ(now.points[n].label, scratch.points[n].label);
  }
  EXPECT_EQ(field.snapshot().count(PointLabel::Accessible), 0u);
  const DeviceView view = field.hostView();
  const double p_W[3] = {1, 0, 0};
  EXPECT_FALSE(view.armFree(p_W));
  std::vector<PointAnswer> answers(1);
  const BatchQuery query = field.batchQuery();
  query.at(std::vector<Eigen::Vector3d>{{1.8, 0.1, 0}}, answers);
  EXPECT_TRUE(answers[0].unknown) << "measured to be free, and not confirmed for long";
  const CapsuleQuery capsule = {{1.8, 0.1, 0}, {1.8, 0.12, 0}, 0.01};
  EXPECT_TRUE(query.along(std::vector<CapsuleQuery>{capsule}).front().unknown);
}

/// (g) Returns that the gate drops are no passes.
TEST(ForgettingField, DroppedReturnsOpenNothing) {
  for (const bool dropped : {true, false}) {
    FieldParams params = paramsOf(kForever_s);
    if (dropped) params.tsdf.max_range_m = 1.7;  // the post is nearer, the wall is not
    AccessibilityField field(armTool(), params);
    fuse(field, 8, 40);
    field.update();
    EXPECT_EQ(field.snapshot().reasons()[static_cast<std::size_t>(PointReason::Changed)] > 0, !dropped);
  }
}

TEST(ForgettingField, WhatCannotBeIsRefused) {
  const auto idOf = [](const FieldParams& params) -> std::string {
    try {
      static_cast<void>(params.resolved());
    } catch (const Error& error) {
      return error.id();
    }
    return "";
  };
  for (const double bad : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(), -kForever_s, 1e300}) {
    EXPECT_EQ(idOf(paramsOf(bad)), "config.range") << bad;
  }
  FieldParams params = paramsOf(60);
  EXPECT_EQ(idOf(params), "");
  EXPECT_NE(params.resolved().describe().find("\nchange full\nfree_for_s 60\n"), std::string::npos);
  params.change.mode = ChangeMode::Block;
  EXPECT_EQ(idOf(params), "config.change");
  params = paramsOf(60);
  params.update.policy = UpdatePolicy::Paper;
  EXPECT_EQ(idOf(params), "config.change");
  params = paramsOf(60);
  params.origin_W = {{0, 0, 0}};
  params.window = FieldWindow{{0, 0}, {128, 128}};
  try {
    const AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
    ADD_FAILURE() << "a tile is no map by itself";
  } catch (const InvalidArgument& error) {
    EXPECT_EQ(error.id(), "config.window");
  }
  params = paramsOf(60);
  params.tsdf.region = UpdateRegion::FullCube;
  EXPECT_EQ(params.resolved().change.mode, ChangeMode::Off);
  EXPECT_EQ(params.resolved().change.free_for_s, kForever_s);
}

}  // namespace
}  // namespace accessvdb::test
