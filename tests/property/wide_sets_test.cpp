// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of more orientations than a mask holds: the yaws among them are yaw, updates equal a full evaluation, several
/// tools are as if alone, states go on, and a GPU says that it cannot.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

constexpr int kPads = 50;

FieldParams paramsWith(const OrientationSet& orientations, double voxel_size_m, int rolls = 1) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.approach.orientations = orientations;
  params.approach.rolls = rolls;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  return params;
}

/// The 180 yaws between orientations straight up and down, which level views never admit.
OrientationSet paddedYaws() {
  std::vector<ToolOrientation> list;
  for (int n = 0; n < kPads; ++n) list.push_back(orientationOf(0, 90, 3.0 * n));
  for (int d = 0; d < 180; ++d) list.push_back(orientationOf(2.0 * d, 0, 0));
  for (int n = 0; n < kPads; ++n) list.push_back(orientationOf(0, -90, 3.0 * n));
  return OrientationSet::of(std::move(list));
}

/// Only returns at about the height of the sensor, far less steep than the 14 degrees from where a vertical tool counts
/// as seen.
std::vector<Scan> levelScans(std::uint64_t seed, int scans, int points) {
  std::vector<Scan> all = wallScans(seed, scans, points);
  for (Scan& scan : all) {
    std::erase_if(scan.points_S, [](const Eigen::Vector3f& p_S) { return std::abs(p_S.z()) > 0.2f * p_S.norm(); });
  }
  return all;
}

TEST(WideSets, PaddedYawIsYaw) {
  ASSERT_GT(paddedYaws().list.size(), 256u);
  for (const char* tool : {"builtin:pruner", "builtin:pencil"}) {
    SCOPED_TRACE(tool);
    AccessibilityField yaw(ToolGeometry::builtin(tool), paramsWith(OrientationSet::yaw(), 0.04)),
        padded(ToolGeometry::builtin(tool), paramsWith(paddedYaws(), 0.04));
    ASSERT_EQ(yaw.collisionLimit(), padded.collisionLimit());
    for (const Scan& scan : levelScans(7, 8, 1500)) {
      yaw.integrateScan(scan.points_S, scan.T_W_S);
      padded.integrateScan(scan.points_S, scan.T_W_S);
      yaw.update();
      padded.update();
      const FieldSnapshot a = yaw.snapshot(), b = padded.snapshot(), scratch = yaw.evaluateFromScratch();
      ASSERT_EQ(a.points.size(), b.points.size());
      for (std::size_t n = 0; n < a.points.size(); ++n) {
        // What is stored of a blocked point may be older with yaw, but never here.
        const SurfacePoint& p = a.points[n].label == PointLabel::Accessible ? a.points[n] : scratch.points[n];
        const SurfacePoint& q = b.points[n];
        ASSERT_EQ(p.label, q.label) << text(p) << "; " << text(q);
        // A steep normal has a vertical direction in its cone, but not one that was seen.
        const bool steep = p.reason == PointReason::Normal && q.reason == PointReason::Unseen;
        ASSERT_TRUE(p.reason == q.reason || steep) << text(p) << "; " << text(q);
        ASSERT_EQ(p.score, q.score);
        ASSERT_EQ(p.direction == kNoDirection ? kNoDirection : p.direction + kPads, q.direction);
        ASSERT_EQ(p.direction_W, q.direction_W);
        ASSERT_EQ(p.normal_W, q.normal_W);
        ASSERT_TRUE(same(a.points[n].stability, q.stability)) << text(a.points[n]) << "; " << text(q);
      }
    }
    expectVaried(padded.snapshot());
  }
}

/// All that is stored, also of blocked points.
void expectEqualToScratch(const AccessibilityField& field, const std::string& when) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    const SurfacePoint &a = now.points[n], &b = scratch.points[n];
    ASSERT_EQ(a.label, b.label) << when << ", point " << n << ": " << text(a) << "; " << text(b);
    ASSERT_EQ(a.reason, b.reason) << when << ", point " << n << ": " << text(a) << "; " << text(b);
    ASSERT_EQ(a.score, b.score) << when << ", point " << n;
    ASSERT_EQ(a.direction, b.direction) << when << ", point " << n;
    ASSERT_EQ(a.roll, b.roll) << when << ", point " << n;
  }
}

TEST(WideSets, StreamsEqualFromScratchAfterEveryUpdate) {
  struct Stream {
    const char* orientations;
    const char* tool;
    double voxel_size_m;
    int num_directions, rolls, max_collisions, budget;
  };
  for (const Stream& stream : {Stream{"sphere:9", "builtin:pruner", 0.06, 180, 3, 0, 0},
                               {"sphere:6+yaw", "builtin:pruner", 0.06, 180, 1, -1, 0},
                               {"pitch:-30:30:10", "builtin:pruner", 0.08, 60, 1, 5, 0},
                               {"sphere:9", "builtin:pruner", 0.08, 180, 1, 3, 400}}) {
    SCOPED_TRACE(std::string(stream.orientations) + ", " + stream.tool);
    const WalkGenerator walk(shortWalk(8, 1000));
    FieldParams params = paramsWith(OrientationSet::parse(stream.orientations), stream.voxel_size_m, stream.rolls);
    params.approach.num_directions = stream.num_directions;
    params.scoring.max_collisions = stream.max_collisions;
    params.update.budget_points = stream.budget;
    ASSERT_GT(params.approach.directionCount(), 256);
    AccessibilityField field(ToolGeometry::builtin(stream.tool), params);
    std::size_t beyond_a_mask = 0;
    for (int frame = 0; frame < walk.frames(); ++frame) {
      const auto scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      UpdateStats stats = field.update();
      while (stats.backlog > 0 && frame % 4 == 3) stats = field.update();
      if (stats.backlog > 0) continue;
      expectEqualToScratch(field, "frame " + std::to_string(frame));
      if (HasFatalFailure()) return;
    }
    const FieldSnapshot snapshot = field.snapshot();
    expectVaried(snapshot);
    for (const SurfacePoint& point : snapshot.points) {
      beyond_a_mask += point.direction != kNoDirection && point.direction > 255 ? 1 : 0;
    }
    EXPECT_GT(beyond_a_mask, 20u);
  }
}

/// Every interface names the direction that has this index in the set.
TEST(WideSets, AreWhatUsersSee) {
  const OrientationSet set = OrientationSet::sphere(3.8);
  const std::vector<ToolOrientation> orientations = set.orientations(180);
  ASSERT_EQ(orientations.size(), 2906u);
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), paramsWith(set, 0.05));
  for (const Scan& scan : wallScans(5, 3, 600)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  const DeviceView view = field.hostView();
  EXPECT_EQ(view.num_directions, 2906);
  const BatchQuery query = field.batchQuery();
  std::size_t far = 0;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.direction == kNoDirection) continue;
    const ToolOrientation& orientation = orientations.at(point.direction);
    ASSERT_LT((point.direction_W - orientation.R_WT.col(0).cast<float>()).norm(), 1e-7f);
    ASSERT_LT((point.orientation_WT.toRotationMatrix() - orientation.R_WT.cast<float>()).cwiseAbs().maxCoeff(), 1e-6f);
    float seen[3];
    ASSERT_TRUE(view.directionOf(point.id, seen));
    ASSERT_LT((Eigen::Vector3f(seen) - point.direction_W).norm(), 1e-6f);
    PointAnswer answer;
    query.at({&point.position_W, 1}, {&answer, 1});
    ASSERT_EQ(answer.direction, point.direction);
    ASSERT_EQ(answer.direction_W, point.direction_W);
    far += point.direction > 2048 ? 1 : 0;
  }
  EXPECT_GT(far, 50u);
}

std::vector<ToolSpec> mixedTools() {
  return {{ToolGeometry::builtin("builtin:pencil"), OrientationSet::yaw(), 0, "level", 0},
          {armTool(), OrientationSet::sphere(9), 1, "wide", 0},
          {boxTool({0.0f, -0.1f, -0.1f}, {0.6f, 0.1f, 0.1f}), OrientationSet::sphere(9), 1, "wide_too", 2},
          {armTool(), OrientationSet::sphere(30), 2, "narrow", 0}};
}

std::string bytesOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Tools with sets of different sizes, two of them with the same wide one: each as if alone, and all after a state.
TEST(WideSets, OfSeveralToolsAreThoseOfEachAlone) {
  const ScratchFolder folder;
  const std::vector<ToolSpec> tools = mixedTools();
  const FieldParams params = paramsWith(OrientationSet::yaw(), 0.05);
  const std::vector<Scan> scans = wallScans(11, 5, 700);
  AccessibilityField all(tools, params), first(tools, params);
  std::vector<AccessibilityField> alone;
  for (const ToolSpec& tool : tools) alone.emplace_back(std::vector<ToolSpec>{tool}, params);
  for (std::size_t n = 0; n < scans.size(); ++n) {
    all.integrateScan(scans[n].points_S, scans[n].T_W_S);
    all.update();
    for (AccessibilityField& field : alone) {
      field.integrateScan(scans[n].points_S, scans[n].T_W_S);
      field.update();
    }
    if (n < 3) first.integrateScan(scans[n].points_S, scans[n].T_W_S);
  }
  for (std::size_t k = 0; k < tools.size(); ++k) {
    SCOPED_TRACE(tools[k].name);
    expectSame(all.toolSnapshot(k), alone[k].snapshot());
    expectVaried(all.toolSnapshot(k));
  }
  first.update();
  first.saveState(folder / "first.avst");
  AccessibilityField second = AccessibilityField::loadState(folder / "first.avst", tools, BackendKind::Cpu, 2);
  for (std::size_t n = 3; n < scans.size(); ++n) second.integrateScan(scans[n].points_S, scans[n].T_W_S);
  second.update();
  const FieldSnapshot whole = all.evaluateFromScratch(), resumed = second.evaluateFromScratch();
  expectSame(whole, resumed);
  all.saveState(folder / "whole.avst");
  second.saveState(folder / "second.avst");
  EXPECT_EQ(bytesOf(folder / "whole.avst").size(), bytesOf(folder / "second.avst").size());
}

/// A list has its own layout of states; with one tool, its state and that of an uninterrupted run are the same bytes.
TEST(WideSets, GoOnFromASavedState) {
  const ScratchFolder folder;
  for (const OrientationSet& set : {OrientationSet::sphere(9), paddedYaws()}) {
    const FieldParams params = paramsWith(set, 0.05);
    const std::vector<Scan> scans = wallScans(4, 6, 800);
    AccessibilityField whole(armTool(), params), first(armTool(), params);
    for (std::size_t n = 0; n < scans.size(); ++n) {
      whole.integrateScan(scans[n].points_S, scans[n].T_W_S);
      if (n < 3) first.integrateScan(scans[n].points_S, scans[n].T_W_S);
      whole.update();
      first.update();
    }
    first.saveState(folder / "first.avst");
    AccessibilityField second = AccessibilityField::loadState(folder / "first.avst", armTool(), BackendKind::Cpu, 2);
    ASSERT_EQ(second.params().approach.directionCount(), set.count(180));
    for (std::size_t n = 3; n < scans.size(); ++n) {
      second.integrateScan(scans[n].points_S, scans[n].T_W_S);
      second.update();
    }
    // Not only labels: what is stored of blocked points is as of now, too. Stability counts from the load.
    FieldSnapshot a = whole.snapshot(), b = second.snapshot();
    for (FieldSnapshot* snapshot : {&a, &b}) {
      for (SurfacePoint& point : snapshot->points) point.stability = 0, point.confident = false;
    }
    expectSame(a, b);
    expectVaried(a);
    whole.saveState(folder / "whole.avst");
    second.saveState(folder / "second.avst");
    EXPECT_EQ(bytesOf(folder / "whole.avst"), bytesOf(folder / "second.avst"));
  }
}

/// Threads, and scans that come with one update or with several.
TEST(WideSets, DoNotDependOnThreadsOrUpdates) {
  const std::vector<Scan> scans = wallScans(13, 5, 800);
  const auto snapshotOf = [&](int threads, bool often) {
    FieldParams params = paramsWith(OrientationSet::sphere(7.5), 0.05, 2);
    params.threads = threads;
    AccessibilityField field(armTool(), params);
    for (const Scan& scan : scans) {
      field.integrateScan(scan.points_S, scan.T_W_S);
      if (often) field.update();
    }
    field.update();
    return field.snapshot();
  };
  const FieldSnapshot one = snapshotOf(1, false);
  expectSame(one, snapshotOf(4, false));
  FieldSnapshot often = snapshotOf(3, true);
  for (std::size_t n = 0; n < one.points.size(); ++n) {
    ASSERT_EQ(one.points[n].label, often.points[n].label);
    ASSERT_EQ(one.points[n].reason, often.points[n].reason);
    ASSERT_EQ(one.points[n].direction, often.points[n].direction);
    ASSERT_EQ(one.points[n].roll, often.points[n].roll);
    ASSERT_EQ(one.points[n].score, often.points[n].score);
  }
}

/// Directions of all tools are numbered together, in 16 bits.
TEST(WideSets, OfSeveralToolsAreLimitedTogether) {
  std::vector<ToolSpec> tools;
  for (int n = 0; n < 17; ++n) {
    tools.push_back({ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(3.25), 1, {}, 0});
  }
  ASSERT_GT(17 * tools.front().orientations.count(180), 65535);
  try {
    const AccessibilityField field(tools, paramsWith(OrientationSet::yaw(), 0.1));
    FAIL() << "nothing was refused";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "orientations.count");
  }
}

}  // namespace
}  // namespace accessvdb::test
