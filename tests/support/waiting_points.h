// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The same random stream into a field with a budget and into one without, on the CPU: points that wait are unscored,
/// exactly as many as the field says, and nothing else differs.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "support/determinism_support.h"
#include "support/walk_generator.h"

namespace accessvdb::test {

inline bool isUnscored(const SurfacePoint& point, PointReason reason) {
  return point.label == PointLabel::Unscored && point.reason == reason && point.score == kNoScore &&
         point.direction == kNoDirection && !point.confident;
}

/// Follows the points of one tool in a field with a budget.
class WaitingModel {
 public:
  /// @param exact  the policy: with the other one, labels also depend on how often a point was scored
  explicit WaitingModel(bool exact) : exact_(exact) {}

  struct Found {
    std::uint64_t waiting = 0;   ///< points that are not told, but without a budget they are
    std::uint64_t withheld = 0;  ///< of them: accessible when they were last told
  };
  /// After an update. @param unlimited  the field without a budget
  [[nodiscard]] Found compare(const FieldSnapshot& limited, const FieldSnapshot& unlimited) {
    Found found;
    EXPECT_EQ(limited.points.size(), unlimited.points.size());
    was_accessible_.resize(limited.points.size(), false);
    for (std::size_t n = 0; n < limited.points.size() && !testing::Test::HasFatalFailure(); ++n) {
      compare(n, limited.points[n], unlimited.points[n], found);
    }
    return found;
  }

 private:
  void compare(std::size_t n, const SurfacePoint& told, const SurfacePoint& all, Found& found) {
    if (isUnscored(told, PointReason::Confidence) && !isUnscored(all, PointReason::Confidence)) {
      ++found.waiting;
      found.withheld += was_accessible_[n] ? 1 : 0;
      return;
    }
    was_accessible_[n] = told.label == PointLabel::Accessible;
    if (!exact_) return;
    ASSERT_EQ(told.label, all.label) << n << ": " << text(told) << "; " << text(all);
    if (told.label == PointLabel::Accessible) {
      ASSERT_TRUE(told.score == all.score && told.direction == all.direction && told.roll == all.roll) << n;
    }
  }

  bool exact_;
  std::vector<bool> was_accessible_;
};

/// A field with a budget, and one without.
struct WaitingCase {
  const char* name;
  std::vector<ToolSpec> tools;
  FieldParams params;
  std::vector<int> budgets = {40, 200, 90, 0, 700, 30};  ///< one after the other
};
inline void PrintTo(const WaitingCase& c, std::ostream* out) { *out << c.name; }

inline std::vector<WaitingCase> waitingCases() {
  const auto spec = [](ToolGeometry tool, const char* orientations, int max_collisions, const char* tool_name = "") {
    return ToolSpec{std::move(tool), OrientationSet::parse(orientations), 0, tool_name, max_collisions};
  };
  const auto paramsAt = [](double voxel_size_m) {
    FieldParams params;
    params.tsdf.voxel_size_m = voxel_size_m;
    return params;
  };
  FieldParams full = paramsAt(0.05), paper = paramsAt(0.05), profile = FieldParams::paper(0.05);
  full.change.mode = ChangeMode::Full;
  paper.update.policy = UpdatePolicy::Paper;
  profile.scoring.collision_distance_m = 0;  // with the profile's, almost nothing collides at such voxels
  profile.scoring.surface_samples = 200;
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner"), pencil = ToolGeometry::builtin("builtin:pencil");
  return {
      {"exact", {spec(pruner, "yaw", 0)}, paramsAt(0.05)},
      {"exact_with_collisions", {spec(pruner, "yaw", 12)}, paramsAt(0.05)},
      {"full_change", {spec(armTool(), "yaw", 5)}, full},
      {"narrow_orientations", {spec(pencil, "sphere:30", -1)}, paramsAt(0.05)},
      {"wide_orientations", {spec(pruner, "sphere:15", -1)}, paramsAt(0.06)},
      {"several_tools",
       {spec(armTool(), "yaw", 40, "arm"), spec(pencil, "sphere:20", -1, "pencil"), spec(pruner, "yaw", 0, "pruner")},
       paramsAt(0.05)},
      {"wide_and_narrow_tools",
       {spec(pruner, "sphere:15", -1, "wide"), spec(armTool(), "yaw", 5, "narrow")},
       paramsAt(0.06)},
      {"paper_policy", {spec(pruner, "yaw", -1)}, paper},
      {"paper_profile", {spec(pruner, "yaw", -1)}, profile}};
}

/// What is told elsewhere than in snapshots.
struct ToldArrays {
  std::vector<PointLabel> label;
  std::vector<PointReason> reason;
  std::vector<std::uint16_t> score, direction;
};

inline void expectToldAlike(const AccessibilityField& field, const FieldSnapshot& told, const ToldArrays& view) {
  ASSERT_EQ(view.label.size(), told.points.size());
  const BatchQuery query = field.batchQuery();
  for (std::size_t n = 0; n < told.points.size(); ++n) {
    const SurfacePoint& point = told.points[n];
    PointAnswer answer;
    query.at({&point.position_W, 1}, {&answer, 1});
    const bool same = view.label[n] == point.label && view.reason[n] == point.reason && view.score[n] == point.score;
    const bool answered = answer.label == point.label && answer.reason == point.reason && answer.score == point.score;
    ASSERT_TRUE(same && answered && answer.point_id == n) << n;
    if (n % 16 == 0) {
      const auto one = field.pointAt(point.position_W);
      ASSERT_TRUE(one && one->label == point.label && one->score == point.score) << n;
    }
    const bool any = point.direction != kNoDirection;  // indices differ: they count through all tools
    ASSERT_TRUE(any == (view.direction[n] != kNoDirection) && any == (answer.direction != kNoDirection)) << n;
  }
}

/// @param viewOf  (field with a budget) -> ToldArrays of its view
template <typename ViewOf>
void expectOnlyWithheld(const WaitingCase& c, std::uint64_t seed, BackendKind backend, const ViewOf& viewOf) {
  const bool exact = c.params.update.policy == UpdatePolicy::Exact;
  FieldParams params = c.params;
  params.threads = 1 + static_cast<int>(seed % 3);
  params.backend = backend;
  AccessibilityField limited(c.tools, params);
  params.backend = BackendKind::Cpu;
  AccessibilityField unlimited(c.tools, params);
  std::vector<WaitingModel> models(c.tools.size(), WaitingModel(exact));
  std::uint64_t with_waiting = 0, all_withheld = 0;
  std::mt19937_64 random(seed);
  WalkOptions options = shortWalk(12, 1200);
  options.seed = seed;
  const WalkGenerator walk(options);
  const std::vector<Scan> wall = wallScans(seed, options.frames, 900);
  std::size_t turn = 0;
  for (int frame = 0; frame < options.frames; ++frame) {
    SCOPED_TRACE("scan " + std::to_string(frame));
    const WalkFrame walked = walk.frame(frame);
    const Scan scan = seed % 2 == 0 ? wall[static_cast<std::size_t>(frame)] : Scan{walked.points_S, walked.T_W_S};
    for (AccessibilityField* field : {&limited, &unlimited}) field->integrateScan(scan.points_S, scan.T_W_S);
    if (random() % 4 == 0) continue;
    static_cast<void>(unlimited.update());
    for (std::uint64_t again = random() % 3 + 1; again > 0; --again) {
      limited.setBudgetPoints(c.budgets[turn++ % c.budgets.size()]);
      const UpdateStats stats = limited.update();
      WaitingModel::Found found;
      for (std::size_t k = 0; k < c.tools.size(); ++k) {
        const auto of_tool = models[k].compare(limited.toolSnapshot(k), unlimited.toolSnapshot(k));
        found.waiting += of_tool.waiting;
        found.withheld += of_tool.withheld;
        if (testing::Test::HasFatalFailure()) return;
      }
      ASSERT_EQ(found.waiting, stats.backlog);
      ASSERT_EQ(found.withheld, stats.withheld_points);
      const FieldSnapshot told = limited.snapshot(), all = unlimited.snapshot();
      for (std::size_t n = 0; n < told.points.size() && exact; ++n) {
        ASSERT_EQ(told.points[n].tools & ~all.points[n].tools, 0u) << n;
        ASSERT_TRUE(told.points[n].label != PointLabel::Accessible || all.points[n].label == PointLabel::Accessible);
        // Nor is one told as blocked that a tool which waits may reach.
        ASSERT_TRUE(told.points[n].label != PointLabel::Blocked || all.points[n].label == PointLabel::Blocked) << n;
      }
      expectToldAlike(limited, told, viewOf(limited));
      if (testing::Test::HasFatalFailure()) return;
      with_waiting += found.waiting > 0 ? 1 : 0;
      all_withheld += found.withheld;
    }
  }
  // Otherwise the comparisons would prove little.
  EXPECT_GT(with_waiting, 4u);
  EXPECT_GT(all_withheld, 50u);
  const FieldSnapshot now = unlimited.snapshot();
  EXPECT_GT(now.count(PointLabel::Accessible), 30u);
  EXPECT_GT(now.count(PointLabel::Blocked), 30u);
}

}  // namespace accessvdb::test
