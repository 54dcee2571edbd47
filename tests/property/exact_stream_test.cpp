// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The guarantee of the exact policy: after every update without a backlog, labels equal those of a full evaluation of
/// the current map, point for point; and so do the score and the direction of every accessible point.
#include <gtest/gtest.h>

#include <cmath>
#include <ostream>
#include <random>

#include "accessvdb/accessibility_field.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

void expectEqualToScratch(const AccessibilityField& field, const std::string& when) {
  const FieldSnapshot now = field.snapshot();
  const FieldSnapshot scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  std::size_t label_differs = 0, best_differs = 0, unscored_differs = 0;
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    const SurfacePoint &a = now.points[n], &b = scratch.points[n];
    label_differs += a.label != b.label ? 1 : 0;
    if (a.label == PointLabel::Unscored && b.label == PointLabel::Unscored) unscored_differs += a.reason != b.reason;
    if (a.label == PointLabel::Accessible && b.label == PointLabel::Accessible) {
      best_differs += a.score != b.score || a.direction != b.direction ? 1 : 0;
    }
    if (label_differs + best_differs == 1 && (a.label != b.label || a.direction != b.direction)) {
      ADD_FAILURE() << when << ": point " << n << " is " << name(a.label) << " " << a.score << " at " << a.direction
                    << ", from scratch " << name(b.label) << " " << b.score << " at " << b.direction;
      break;
    }
  }
  EXPECT_EQ(label_differs, 0u) << when;
  EXPECT_EQ(best_differs, 0u) << when;
  EXPECT_EQ(unscored_differs, 0u) << when;
}

struct Case {
  std::uint64_t seed;
  const char* tool;
  double voxel_size_m;
  int max_collisions;
  int every;  ///< scans between updates
  ToolForm form = ToolForm::Voxels;
  double confidence_min = 0.2;
  double point_spacing_m = 0;
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.tool << " at " << c.voxel_size_m << " m, " << (c.form == ToolForm::Voxels ? "voxels" : "samples")
       << ", limit " << c.max_collisions << ", " << c.every << " scans an update, confidence " << c.confidence_min;
  if (c.point_spacing_m > 0) *out << ", points " << c.point_spacing_m << " m apart";
}

class ExactStream : public testing::TestWithParam<Case> {};

TEST_P(ExactStream, EqualsFromScratchAfterEveryUpdate) {
  const Case& c = GetParam();
  test::WalkOptions walk_options;
  walk_options.frames = 16;
  walk_options.rays_per_frame = 1500;
  walk_options.seed = c.seed;
  walk_options.range_noise_m = 0.02;
  walk_options.max_range_m = 8;
  walk_options.length_m = 4;
  const test::WalkGenerator walk(walk_options);
  FieldParams params;
  params.tsdf.voxel_size_m = c.voxel_size_m;
  params.scoring.max_collisions = c.max_collisions;
  params.scoring.form = c.form;
  params.scoring.confidence_min = c.confidence_min;
  params.scoring.surface_samples = 60;  // for that form; few, for speed
  params.scoring.point_spacing_m = c.point_spacing_m;
  AccessibilityField field(ToolGeometry::builtin(c.tool), params);
  std::uint64_t tests = 0, labels_seen = 0, chosen_again = 0;
  std::vector<SurfacePoint> before;
  for (int frame = 0; frame < walk_options.frames; ++frame) {
    const auto scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    if (frame % c.every != 0) continue;
    const UpdateStats stats = field.update();
    EXPECT_EQ(stats.backlog, 0u);
    tests += stats.direction_tests;
    labels_seen += stats.label_changes;
    expectEqualToScratch(field, "frame " + std::to_string(frame));
    if (HasFailure()) return;
    const std::vector<SurfacePoint> now = field.snapshot().points;
    for (std::size_t n = 0; n < before.size(); ++n) {
      chosen_again += before[n].reason == PointReason::BesideSurface && now[n].label != PointLabel::Unscored ? 1 : 0;
    }
    before = now;
  }
  if (c.point_spacing_m > 0) {
    EXPECT_GT(chosen_again, 50u);
  }
  EXPECT_GT(tests, 0u);
  EXPECT_GT(field.snapshot().count(PointLabel::Accessible), 50u);  // otherwise the comparison would prove nothing
  EXPECT_GT(field.snapshot().count(PointLabel::Blocked), 50u);
  EXPECT_GT(labels_seen, 500u);
}

INSTANTIATE_TEST_SUITE_P(
    Streams, ExactStream,
    testing::Values(Case{.seed = 1, .tool = "builtin:pruner", .voxel_size_m = 0.05, .max_collisions = 0, .every = 1},
                    Case{.seed = 2, .tool = "builtin:pencil", .voxel_size_m = 0.03, .max_collisions = 0, .every = 1},
                    Case{.seed = 3, .tool = "builtin:pruner", .voxel_size_m = 0.08, .max_collisions = 40, .every = 1},
                    Case{.seed = 4, .tool = "builtin:pruner", .voxel_size_m = 0.05, .max_collisions = 12, .every = 3},
                    // Samples are tested direction by direction: there is no table of directions by offset.
                    Case{.seed = 5,
                         .tool = "builtin:pruner",
                         .voxel_size_m = 0.08,
                         .max_collisions = 2,
                         .every = 2,
                         .form = ToolForm::SurfaceSamples},
                    Case{.seed = 6,
                         .tool = "builtin:pruner",
                         .voxel_size_m = 0.06,
                         .max_collisions = 0,
                         .every = 2,
                         .confidence_min = 0.0},
                    // So many collisions that freed voxels are counted by twos (FreedWord).
                    Case{.seed = 8,
                         .tool = "builtin:pruner",
                         .voxel_size_m = 0.05,
                         .max_collisions = 12,
                         .every = 1,
                         .point_spacing_m = 0.05},
                    Case{.seed = 9,
                         .tool = "builtin:pencil",
                         .voxel_size_m = 0.03,
                         .max_collisions = 0,
                         .every = 2,
                         .point_spacing_m = 0.06},
                    Case{.seed = 10,
                         .tool = "builtin:pruner",
                         .voxel_size_m = 0.02,
                         .max_collisions = 400,
                         .every = 1,
                         .point_spacing_m = 0.04},
                    Case{
                        .seed = 7, .tool = "builtin:pruner", .voxel_size_m = 0.02, .max_collisions = 400, .every = 1}));

/// Random clutter near the sensor: many flips both ways, few returns per voxel.
TEST(ExactStream, EqualsFromScratchOnRandomClutter) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    std::mt19937_64 random(seed);
    const auto unit = [&] { return static_cast<double>(random() >> 11) * 0x1.0p-53; };
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.scoring.max_collisions = seed % 2 == 0 ? 0 : 20;
    AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
    for (int frame = 0; frame < 8; ++frame) {
      Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
      T_W_S.translation() = Eigen::Vector3d(3 * unit(), 3 * unit(), unit());
      std::vector<Eigen::Vector3f> points;
      for (int n = 0; n < 300; ++n) {
        const Eigen::Vector3d p_W(4 + std::floor(3 * unit()) * 0.4 + 0.05 * unit(), 3 * unit(), 1.5 * unit());
        points.push_back((T_W_S.inverse() * p_W).cast<float>());
      }
      field.integrateScan(points, T_W_S);
      field.update();
      expectEqualToScratch(field, "seed " + std::to_string(seed) + " frame " + std::to_string(frame));
      if (HasFailure()) return;
    }
  }
}

/// A budget only delays: once the backlog is empty, nothing differs.
TEST(ExactStream, BudgetOnlyDelays) {
  test::WalkOptions walk_options;
  walk_options.frames = 12;
  walk_options.rays_per_frame = 1500;
  walk_options.range_noise_m = 0.02;
  walk_options.max_range_m = 8;
  const test::WalkGenerator walk(walk_options);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.update.budget_points = 150;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  std::uint64_t most_backlog = 0;
  for (int frame = 0; frame < walk_options.frames; ++frame) {
    const auto scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    most_backlog = std::max(most_backlog, field.update().backlog);
  }
  EXPECT_GT(most_backlog, 500u);
  for (int n = 0; n < 1000; ++n) {
    if (field.update().backlog == 0) break;
  }
  expectEqualToScratch(field, "after the backlog");
}

/// So does one that changes from update to update, or goes and comes; and the same ones give the same bits.
TEST(ExactStream, ChangingBudgetsOnlyDelay) {
  test::WalkOptions walk_options;
  walk_options.frames = 14;
  walk_options.rays_per_frame = 1500;
  walk_options.range_noise_m = 0.02;
  walk_options.max_range_m = 8;
  const test::WalkGenerator walk(walk_options);
  for (const char* orientations : {"yaw", "sphere:15"}) {  // the last one is a wide set
    SCOPED_TRACE(orientations);
    std::vector<AccessibilityField> fields;
    for (const int threads : {1, 3}) {
      FieldParams params;
      params.tsdf.voxel_size_m = 0.05;
      params.approach.orientations = OrientationSet::parse(orientations);
      params.threads = threads;
      fields.emplace_back(ToolGeometry::builtin("builtin:pruner"), params);
    }
    std::mt19937 random(3);
    std::uint64_t with_backlog = 0, out_of_date = 0, all_at_once = 0, longest = 0;
    const auto update = [&](int budget_points, bool waited) {
      std::vector<UpdateStats> stats;
      for (AccessibilityField& field : fields) {
        field.setBudgetPoints(budget_points);
        stats.push_back(field.update());
      }
      ASSERT_EQ(stats[0].backlog, stats[1].backlog);
      ASSERT_EQ(stats[0].backlog_updates, stats[1].backlog_updates);
      ASSERT_EQ(stats[0].backlog_updates > 0, stats[0].backlog > 0);
      if (budget_points > 0) {
        EXPECT_LE(stats[0].label_changes, static_cast<std::uint64_t>(budget_points));
      } else {
        EXPECT_EQ(stats[0].backlog, 0u);
        all_at_once += waited ? 1 : 0;
      }
      longest = std::max(longest, stats[0].backlog_updates);
      const FieldSnapshot a = fields[0].snapshot(), b = fields[1].snapshot(), scratch = fields[0].evaluateFromScratch();
      std::uint64_t differ = 0;
      for (std::size_t n = 0; n < a.points.size(); ++n) {
        const SurfacePoint &p = a.points[n], &q = b.points[n];
        ASSERT_TRUE(p.label == q.label && p.reason == q.reason && p.direction == q.direction && p.score == q.score &&
                    p.stability == q.stability);
        differ += p.label != scratch.points[n].label ? 1 : 0;
      }
      EXPECT_LE(differ, stats[0].backlog);
      with_backlog += stats[0].backlog > 0 ? 1 : 0;
      out_of_date += differ;
    };
    bool waits = false;
    for (int frame = 0; frame < walk_options.frames && !testing::Test::HasFailure(); ++frame) {
      const auto scan = walk.frame(frame);
      for (AccessibilityField& field : fields) field.integrateScan(scan.points_S, scan.T_W_S);
      constexpr int kBudgets[] = {40, 200, 0, 700, 100'000};
      for (int turn = 0; turn <= frame % 3; ++turn) {
        const int budget_points = kBudgets[std::uniform_int_distribution<std::size_t>(0, 4)(random)];
        update(budget_points, waits);
        waits = budget_points > 0 && budget_points < 1000;
        if (HasFailure()) return;
      }
    }
    update(0, waits);
    expectEqualToScratch(fields[0], "at the end");
    EXPECT_GT(with_backlog, 5u);
    EXPECT_GT(out_of_date, 50u);
    EXPECT_GT(all_at_once, 1u);
    EXPECT_GT(longest, 1u);
  }
}

}  // namespace
}  // namespace accessvdb
