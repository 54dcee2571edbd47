// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool that rolls about its body: what a list of every roll finds, never less than without, the same after updates
/// as from scratch.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "support/determinism_support.h"
#include "support/walk_generator.h"
#include "tool/tool_rolls.h"

namespace accessvdb::test {
namespace {

/// ACCESSVDB_ORIENTATIONS_DEVICE=cuda: fields whose tool rolls are on the GPU.
BackendKind rollingBackend() { return backendNamedBy("ACCESSVDB_ORIENTATIONS_DEVICE"); }

FieldParams paramsWith(const OrientationSet& orientations, int rolls, double voxel_size_m = 0.05) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.approach.orientations = orientations;
  params.approach.rolls = rolls;
  params.backend = rollingBackend();
  params.threads = 2;
  return params;
}

/// Every roll of every axis, the rolls of an axis one after the other.
OrientationSet listOfEveryRoll(const AccessibilityField& field) {
  const ApproachParams& approach = field.params().approach;
  const internal::ToolRolls rolls = internal::toolRolls(field.tool(), approach);
  std::vector<ToolOrientation> list;
  for (const ToolOrientation& axis : approach.orientations.orientations(approach.num_directions)) {
    for (int roll = 0; roll < rolls.count; ++roll) list.push_back(internal::rolledBy(axis, rolls, roll));
  }
  return OrientationSet::of(std::move(list));
}

/// @param everything  also what is only said of blocked points, which a single evaluation guarantees
void expectTheSame(const FieldSnapshot& rolled, const FieldSnapshot& listed, int rolls, bool everything,
                   const std::string& when) {
  ASSERT_EQ(rolled.points.size(), listed.points.size());
  for (std::size_t n = 0; n < rolled.points.size(); ++n) {
    const SurfacePoint &a = rolled.points[n], &b = listed.points[n];
    ASSERT_EQ(a.label, b.label) << when << ", point " << n << ": " << text(a) << "; " << text(b);
    if (!everything && a.label != PointLabel::Accessible) continue;
    ASSERT_EQ(a.reason, b.reason) << when << ", point " << n;
    ASSERT_EQ(a.score, b.score) << when << ", point " << n;
    if (a.direction == kNoDirection || b.direction == kNoDirection) {
      ASSERT_EQ(a.direction, b.direction);
      continue;
    }
    ASSERT_EQ(a.direction * rolls + a.roll, b.direction) << when << ", point " << n << ": " << text(a);
    ASSERT_EQ(a.orientation_WT.coeffs(), b.orientation_WT.coeffs());
  }
}

/// No core, no bound and no roll on that side: each is an orientation of its own there.
TEST(Rolls, FindWhatAListOfEveryRollFinds) {
  struct Case {
    const char* orientations;
    ToolGeometry tool;
    int rolls;
    int max_collisions;
    ToolForm form = ToolForm::Voxels;
  };
  std::size_t compared = 0, rolled = 0;
  for (const Case& c :
       {Case{"sphere:45", armTool(), 12, 0}, Case{"sphere:30", ToolGeometry::builtin("builtin:pruner"), 4, 0},
        Case{"sphere:45", ToolGeometry::builtin("builtin:pruner"), 6, 25}, Case{"pitch:-30:30:30", armTool(), 7, 10},
        Case{"sphere:45", armTool(), 5, 3, ToolForm::SurfaceSamples}}) {
    SCOPED_TRACE(std::string(c.orientations) + ", " + c.tool.name() + ", " + std::to_string(c.rolls) + " rolls");
    FieldParams params = paramsWith(OrientationSet::parse(c.orientations), c.rolls, 0.06);
    params.approach.num_directions = 12;
    params.scoring.max_collisions = c.max_collisions;
    params.scoring.form = c.form;
    params.scoring.surface_samples = 120;
    AccessibilityField field(c.tool, params);
    FieldParams of_list = params;
    of_list.approach.orientations = listOfEveryRoll(field);
    of_list.approach.rolls = 1;
    of_list.backend = BackendKind::Cpu;
    AccessibilityField list(c.tool, of_list);
    const WalkGenerator walk(shortWalk(7, 1500));
    for (int frame = 0; frame < 7; ++frame) {
      const auto scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      list.integrateScan(scan.points_S, scan.T_W_S);
      field.update();
      list.update();
      const std::string when = "frame " + std::to_string(frame);
      expectTheSame(field.snapshot(), list.snapshot(), c.rolls, frame == 0, when);
      if (HasFatalFailure()) return;
      expectTheSame(field.evaluateFromScratch(), list.evaluateFromScratch(), c.rolls, true, when + ", from scratch");
      if (HasFatalFailure()) return;
    }
    expectVaried(field.snapshot());
    for (const SurfacePoint& point : field.snapshot().points) {
      ++compared;
      rolled += point.roll > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 10000u);
  EXPECT_GT(rolled, 200u);
}

/// Without a backlog also the roll is that of a full evaluation, whatever was tested on the way.
TEST(Rolls, OfStreamsEqualFromScratch) {
  struct Stream {
    const char* orientations;
    const char* tool;
    int rolls, max_collisions, budget;
    double voxel_size_m;
  };
  for (const Stream& stream : {Stream{"sphere:12.5", "builtin:pruner", 0, 0, 0, 0.05},
                               {"sphere:30", "builtin:pruner", 0, 3, 400, 0.08},
                               {"sphere:20", "builtin:pencil", 3, 0, 0, 0.03},
                               {"yaw", "builtin:pruner", 4, 12, 0, 0.06}}) {
    SCOPED_TRACE(std::string(stream.orientations) + ", " + stream.tool);
    FieldParams params = paramsWith(OrientationSet::parse(stream.orientations), stream.rolls, stream.voxel_size_m);
    params.scoring.max_collisions = stream.max_collisions;
    params.update.budget_points = stream.budget;
    AccessibilityField field(ToolGeometry::builtin(stream.tool), params);
    ASSERT_GT(field.params().approach.rolls, 1);
    const WalkGenerator walk(shortWalk(10, 1500));
    std::size_t rolled = 0;
    for (int frame = 0; frame < 10; ++frame) {
      const auto scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      UpdateStats stats = field.update();
      while (stats.backlog > 0 && frame % 3 == 2) stats = field.update();
      if (stats.backlog > 0) continue;
      const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
      for (std::size_t n = 0; n < now.points.size(); ++n) {
        const SurfacePoint &a = now.points[n], &b = scratch.points[n];
        ASSERT_EQ(a.label, b.label) << "frame " << frame << ", point " << n << ": " << text(a) << "; " << text(b);
        if (a.label != PointLabel::Accessible) continue;
        ASSERT_EQ(a.score, b.score) << "frame " << frame << ", point " << n;
        ASSERT_EQ(a.direction, b.direction) << "frame " << frame << ", point " << n;
        ASSERT_EQ(a.roll, b.roll) << "frame " << frame << ", point " << n;
        rolled += a.roll > 0 ? 1 : 0;
      }
    }
    EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 50u);
    if (std::string(stream.tool) == "builtin:pruner") {
      EXPECT_GT(rolled, 20u);
    }
  }
}

FieldSnapshot mapped(const ToolGeometry& tool, const FieldParams& params, const std::vector<Scan>& scans) {
  AccessibilityField field(tool, params);
  for (const Scan& scan : scans) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  return field.snapshot();
}

/// Random multiples: the rolls of the one are among those of the other.
TEST(Rolls, NeverTakeAccessAway) {
  AccessGains gains;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    std::mt19937_64 random(seed);
    const int few = 1 + static_cast<int>(random() % 3), many = few * (2 + static_cast<int>(random() % 4));
    const std::vector<Scan> scans = wallScans(seed, 4, 1200);
    const OrientationSet set =
        seed % 3 == 0 ? OrientationSet::pitch(-60, 60, 60) : OrientationSet::sphere(seed % 2 == 0 ? 30 : 25);
    const auto fieldOf = [&](int rolls) {
      FieldParams params = paramsWith(set, rolls);
      params.approach.num_directions = 20;
      return mapped(armTool(), params, scans);
    };
    SCOPED_TRACE("seed " + std::to_string(seed));
    gains.add(fieldOf(few), fieldOf(many));
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(gains.compared, 10000u);
  EXPECT_GT(gains.gained, 100u);
  EXPECT_GT(gains.kept, 200u);
}

/// A tool from a lathe needs none: others only move its facets and the rounding to voxels.
TEST(Rolls, OfATurnedToolMayOnlyGain) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  const std::vector<Scan> scans = wallScans(4, 5, 1500);
  const auto labelsBy = [&](int rolls) {
    return mapped(pencil, paramsWith(OrientationSet::sphere(20), rolls, 0.02), scans);
  };
  AccessibilityField by_rule(pencil, paramsWith(OrientationSet::sphere(20), 0, 0.02));
  EXPECT_EQ(by_rule.params().approach.rolls, 1);
  const FieldSnapshot one = labelsBy(0), twelve = labelsBy(12);
  std::size_t accessible = 0, gained = 0;
  for (std::size_t n = 0; n < one.points.size(); ++n) {
    const bool before = one.points[n].label == PointLabel::Accessible,
               after = twelve.points[n].label == PointLabel::Accessible;
    ASSERT_TRUE(!before || after) << n;
    accessible += before ? 1 : 0;
    gained += !before && after ? 1 : 0;
  }
  EXPECT_GT(accessible, 100u);
  EXPECT_LE(gained, accessible / 20);
}

/// The orientation of a point is that of its axis, turned about the body; access maps name the same roll.
TEST(Rolls, AreWhatUsersSee) {
  AccessibilityField field(armTool(), paramsWith(OrientationSet::sphere(30), 0));
  ASSERT_EQ(field.params().approach.rolls, 12);
  for (const Scan& scan : wallScans(5, 4, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  const std::vector<ToolOrientation> axes = field.params().approach.orientations.orientations(180);
  const FieldSnapshot snapshot = field.snapshot();
  std::size_t rolled = 0, asked = 0;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.direction == kNoDirection) continue;
    const Eigen::Matrix3d expected =
        axes.at(point.direction).R_WT *
        Eigen::AngleAxisd(std::numbers::pi / 6 * point.roll, Eigen::Vector3d::UnitX()).toRotationMatrix();
    ASSERT_LT((point.orientation_WT.toRotationMatrix() - expected.cast<float>()).cwiseAbs().maxCoeff(), 1e-6f);
    rolled += point.roll > 0 ? 1 : 0;
    if (point.roll == 0 || ++asked % 20 != 0) continue;
    const std::optional<AccessMap> map = field.accessMap(point.position_W);
    ASSERT_TRUE(map);
    const DirectionOutcome& outcome = map->directions.at(point.direction);
    EXPECT_EQ(outcome.roll, point.roll);
    EXPECT_EQ(outcome.score, point.score);
    EXPECT_EQ(outcome.orientation_WT.coeffs(), point.orientation_WT.coeffs());
  }
  EXPECT_GT(rolled, 100u);
  EXPECT_GT(asked, 20u);
  if (rollingBackend() == BackendKind::Cuda) return;
  const DeviceView view = field.hostView();
  ASSERT_NE(view.points.roll, nullptr);
  for (const SurfacePoint& point : snapshot.points) {
    ASSERT_EQ(view.points.roll[point.id], point.roll);
  }
  EXPECT_EQ(AccessibilityField(armTool(), paramsWith(OrientationSet::sphere(30), 1)).hostView().points.roll, nullptr);
}

TEST(Rolls, AreCheckedAndDescribed) {
  const auto idOf = [](const FieldParams& params) -> std::string {
    try {
      static_cast<void>(params.resolved());
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return "";
  };
  for (const int rolls : {-1, 65, 1000}) EXPECT_EQ(idOf(paramsWith(OrientationSet::sphere(30), rolls)), "config.range");
  for (const int rolls : {0, 1, 64}) EXPECT_EQ(idOf(paramsWith(OrientationSet::sphere(30), rolls)), "");
  FieldParams paper = FieldParams::paper(0.02);
  paper.approach.rolls = 1;
  EXPECT_EQ(idOf(paper), "");
  paper.approach.rolls = 2;
  EXPECT_EQ(idOf(paper), "orientations.policy");
  const auto described = [](const OrientationSet& set, int rolls) {
    return AccessibilityField(ToolGeometry::builtin("builtin:pruner"), paramsWith(set, rolls, 0.1)).params().describe();
  };
  EXPECT_EQ(described(OrientationSet::yaw(), 0).find("roll"), std::string::npos);
  EXPECT_EQ(described(OrientationSet::pitch(30, 30, 1), 1).find("roll"), std::string::npos);
  EXPECT_NE(described(OrientationSet::sphere(45), 0).find("\norientations sphere:45\nrolls 6\n"), std::string::npos);
  EXPECT_NE(described(OrientationSet::yaw(), 3).find("\norientations yaw\nrolls 3\n"), std::string::npos);
}

}  // namespace
}  // namespace accessvdb::test
