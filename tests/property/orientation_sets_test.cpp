// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of orientations: yaw written in another way is yaw, more orientations never take access away, and updates equal
/// a full evaluation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/error.h"
#include "support/determinism_support.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

OrientationSet listedYaws() {
  std::vector<ToolOrientation> list;
  for (int d = 0; d < 180; ++d) list.push_back(orientationOf(2.0 * d, 0, 0));
  return OrientationSet::of(std::move(list));
}

FieldParams paramsWith(const OrientationSet& orientations, double voxel_size_m = 0.05) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.approach.orientations = orientations;
  params.backend = BackendKind::Cpu;
  params.threads = 2;
  return params;
}

/// ACCESSVDB_ORIENTATIONS_DEVICE=cuda: all fields but those of yaw are on the GPU.
BackendKind orientedBackend() { return backendNamedBy("ACCESSVDB_ORIENTATIONS_DEVICE"); }

void expectSameOrientations(const FieldSnapshot& a, const FieldSnapshot& b) {
  for (std::size_t n = 0; n < a.points.size(); ++n) {
    ASSERT_EQ(a.points[n].orientation_WT.coeffs(), b.points[n].orientation_WT.coeffs()) << n;
  }
}

/// No short cut: such a field has axes in place of yaws, in every table that scoring reads.
void expectGeneral(const AccessibilityField& field) {
  const bool on_gpu = field.params().backend == BackendKind::Cuda;
  const DeviceView view = on_gpu ? field.deviceView() : field.hostView();
  EXPECT_NE(view.axes_xyz, nullptr);
  EXPECT_EQ(view.direction_xy, nullptr);
}

TEST(OrientationSets, YawWrittenInAnotherWayHasTheBitsOfYaw) {
  WalkOptions walk_options;
  walk_options.frames = 8;
  walk_options.rays_per_frame = 1500;
  walk_options.range_noise_m = 0.02;
  walk_options.max_range_m = 8;
  walk_options.length_m = 4;
  const WalkGenerator walk(walk_options);
  for (const auto& [tool, form] : {std::pair{"builtin:pruner", ToolForm::Voxels},
                                   {"builtin:pencil", ToolForm::Voxels},
                                   {"builtin:pruner", ToolForm::SurfaceSamples}}) {
    for (const OrientationSet& orientations : {listedYaws(), OrientationSet::pitch(0, 0, 1)}) {
      SCOPED_TRACE(std::string(tool) + ", " + orientations.text());
      FieldParams params = paramsWith(orientations, 0.06);
      params.scoring.form = form;
      params.scoring.surface_samples = 80;
      FieldParams of_yaw = params;
      of_yaw.approach.orientations = OrientationSet::yaw();
      params.backend = orientedBackend();
      AccessibilityField yaw(ToolGeometry::builtin(tool), of_yaw), general(ToolGeometry::builtin(tool), params);
      expectGeneral(general);
      EXPECT_EQ(yaw.hostView().axes_xyz, nullptr);
      for (int frame = 0; frame < walk_options.frames; ++frame) {
        const auto scan = walk.frame(frame);
        yaw.integrateScan(scan.points_S, scan.T_W_S);
        general.integrateScan(scan.points_S, scan.T_W_S);
        if (frame % 3 != 0) continue;  // several scans before an update, and at the end one that nothing follows
        yaw.update();
        general.update();
        const FieldSnapshot a = yaw.evaluateFromScratch(), b = general.evaluateFromScratch();
        expectSame(a, b);
        expectSameOrientations(a, b);
        // What is stored does not depend on evaluations that confirm it.
        expectSame(yaw.snapshot(), general.snapshot());
      }
      expectVaried(yaw.snapshot());
    }
  }
}

/// Random orientations of a random superset.
TEST(OrientationSets, MoreOfThemNeverTakeAccessAway) {
  AccessGains gains;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    std::mt19937_64 random(seed);
    std::vector<ToolOrientation> superset;
    const int size = 20 + static_cast<int>(random() % 200);
    for (int n = 0; n < size; ++n) {
      superset.push_back(orientationOf(uniform(random, 0, 360), n % 4 == 0 ? 0 : uniform(random, -90, 90),
                                       n % 3 == 0 ? 0 : uniform(random, -180, 180)));
    }
    std::vector<ToolOrientation> subset;
    for (const ToolOrientation& orientation : superset) {
      if (random() % 3 == 0) subset.push_back(orientation);
    }
    if (subset.empty()) subset.push_back(superset.back());
    const std::vector<Scan> scans = wallScans(seed, 4, 1200);
    const auto fieldOf = [&](const OrientationSet& orientations) {
      FieldParams params = paramsWith(orientations);
      params.backend = orientedBackend();
      AccessibilityField field(armTool(), params);
      for (const Scan& scan : scans) field.integrateScan(scan.points_S, scan.T_W_S);
      field.update();
      return field.snapshot();
    };
    SCOPED_TRACE("seed " + std::to_string(seed));
    gains.add(fieldOf(OrientationSet::of(subset)), fieldOf(OrientationSet::of(superset)));
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(gains.compared, 10000u);
  EXPECT_GT(gains.gained, 200u);
  EXPECT_GT(gains.kept, 200u);
}

/// The collision limit is that of the yaw directions, whatever is added to them.
TEST(OrientationSets, DoNotChangeTheCollisionLimit) {
  const auto accessible = [](const OrientationSet& orientations) {
    FieldParams params = paramsWith(orientations);
    params.approach.num_directions = 60;
    AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
    for (const Scan& scan : wallScans(3, 4, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
    field.update();
    return field.snapshot();
  };
  const FieldSnapshot yaw = accessible(OrientationSet::yaw()), more = accessible(OrientationSet::sphere(20, true));
  std::size_t gained = 0;
  for (std::size_t n = 0; n < yaw.points.size(); ++n) {
    const bool before = yaw.points[n].label == PointLabel::Accessible;
    ASSERT_TRUE(!before || more.points[n].label == PointLabel::Accessible) << n;
    gained += !before && more.points[n].label == PointLabel::Accessible ? 1 : 0;
  }
  EXPECT_GT(gained, 50u);
}

void expectEqualToScratch(const AccessibilityField& field, const std::string& when) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    const SurfacePoint &a = now.points[n], &b = scratch.points[n];
    ASSERT_EQ(a.label, b.label) << when << ", point " << n << ": " << text(a) << "; " << text(b);
    if (a.label != PointLabel::Accessible) continue;
    ASSERT_EQ(a.score, b.score) << when << ", point " << n;
    ASSERT_EQ(a.direction, b.direction) << when << ", point " << n;
    ASSERT_EQ(a.roll, b.roll) << when << ", point " << n;
  }
}

TEST(OrientationSets, StreamsEqualFromScratchAfterEveryUpdate) {
  struct Stream {
    const char* orientations;
    const char* tool;
    double voxel_size_m;
    int num_directions, max_collisions, budget;
  };
  for (const Stream& stream : {Stream{"sphere:12.5", "builtin:pruner", 0.05, 180, 0, 0},
                               {"sphere:12.5", "builtin:pencil", 0.03, 180, 0, 0},
                               {"pitch:-30:30:10", "builtin:pruner", 0.06, 36, 20, 0},
                               {"sphere:30", "builtin:pruner", 0.08, 180, 3, 400}}) {
    SCOPED_TRACE(std::string(stream.orientations) + ", " + stream.tool);
    WalkOptions walk_options;
    walk_options.frames = 12;
    walk_options.rays_per_frame = 1500;
    walk_options.range_noise_m = 0.02;
    walk_options.max_range_m = 8;
    walk_options.length_m = 4;
    const WalkGenerator walk(walk_options);
    FieldParams params = paramsWith(OrientationSet::parse(stream.orientations), stream.voxel_size_m);
    params.approach.num_directions = stream.num_directions;
    params.scoring.max_collisions = stream.max_collisions;
    params.update.budget_points = stream.budget;
    params.backend = orientedBackend();
    AccessibilityField field(ToolGeometry::builtin(stream.tool), params);
    expectGeneral(field);
    std::uint64_t tests = 0, full = 0;
    for (int frame = 0; frame < walk_options.frames; ++frame) {
      const auto scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      UpdateStats stats = field.update();
      tests += stats.direction_tests;
      while (stats.backlog > 0 && frame % 4 == 3) stats = field.update();
      if (stats.backlog > 0) continue;
      std::uint64_t from_scratch = 0;
      static_cast<void>(field.evaluateFromScratch(&from_scratch));
      full += from_scratch;
      expectEqualToScratch(field, "frame " + std::to_string(frame));
      if (HasFatalFailure()) return;
    }
    EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 50u);
    EXPECT_GT(field.snapshot().count(PointLabel::Blocked), 50u);
    if (stream.budget == 0) {
      EXPECT_LT(tests, full);  // most of what is known stays known
    }
  }
}

/// Directions in the answers of every interface are those of the set.
TEST(OrientationSets, AreWhatUsersSee) {
  FieldParams params = paramsWith(OrientationSet::sphere(15));
  params.approach.rolls = 1;
  AccessibilityField field(armTool(), params);
  for (const Scan& scan : wallScans(5, 4, 1500)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  const std::vector<ToolOrientation> orientations = params.approach.orientations.orientations(180);
  const FieldSnapshot snapshot = field.snapshot();
  const DeviceView view = field.hostView();
  const BatchQuery query = field.batchQuery();
  std::size_t tilted = 0;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.direction == kNoDirection) continue;
    const ToolOrientation& orientation = orientations.at(point.direction);
    const Eigen::Vector3f axis = orientation.R_WT.col(0).cast<float>();
    ASSERT_LT((point.direction_W - axis).norm(), 1e-7f);
    ASSERT_LT((point.orientation_WT.toRotationMatrix() - orientation.R_WT.cast<float>()).cwiseAbs().maxCoeff(), 1e-6f);
    ASSERT_NEAR(point.yaw_rad, orientation.yaw_rad, 1e-6);
    float seen[3];
    ASSERT_TRUE(view.directionOf(point.id, seen));
    ASSERT_LT((Eigen::Vector3f(seen) - axis).norm(), 1e-7f);
    PointAnswer answer;
    query.at({&point.position_W, 1}, {&answer, 1});
    ASSERT_EQ(answer.direction_W, point.direction_W);
    tilted += std::abs(axis.z()) > 0.1f ? 1 : 0;
  }
  EXPECT_GT(tilted, 100u);
}

TEST(OrientationSets, AreRefusedByThePapersPolicy) {
  const auto idOf = [](const FieldParams& params) -> std::string {
    try {
      static_cast<void>(params.resolved());
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return "";
  };
  FieldParams paper = FieldParams::paper(0.02);
  EXPECT_EQ(idOf(paper), "");
  paper.approach.orientations = OrientationSet::sphere(15);
  EXPECT_EQ(idOf(paper), "orientations.policy");
  FieldParams product = paramsWith(OrientationSet::sphere(15));
  EXPECT_EQ(idOf(product), "");
  product.approach.viewpoints = true;
  EXPECT_EQ(idOf(product), "orientations.policy");
  product.approach.viewpoints = false;
  product.approach.coarse_to_fine = true;
  EXPECT_EQ(idOf(product), "orientations.policy");
  product.approach.coarse_to_fine = false;
  product.approach.orientations = OrientationSet::sphere(0);
  EXPECT_EQ(idOf(product), "orientations.range");
}

TEST(OrientationSets, AreDescribed) {
  EXPECT_EQ(paramsWith(OrientationSet::yaw()).resolved().describe().find("orientations"), std::string::npos);
  const std::string text = paramsWith(OrientationSet::sphere(12.5)).resolved().describe();
  EXPECT_NE(text.find("\norientations sphere:12.5\n"), std::string::npos) << text;
}

}  // namespace
}  // namespace accessvdb::test
