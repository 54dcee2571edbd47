// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The same random stream into a field with a budget and into one without, on the CPU: points that wait are unscored,
/// exactly as many as the field says, and nothing else differs.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "accessvdb/device_view.h"
#include "accessvdb/tool_spec.h"
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
    std::uint64_t waiting = 0;    ///< points that are not told, but without a budget they are
    std::uint64_t withheld = 0;   ///< of them: accessible when they were last told
    std::uint64_t gone = 0;       ///< points whose surface has gone, which is told in any case: they may wait
    std::uint64_t came_back = 0;  ///< of those that wait: gone when they were last told
    std::uint64_t beside = 0;     ///< of those that wait: beside the surface, which is not told until their turn comes
    [[nodiscard]] std::uint64_t unsure() const { return gone + came_back; }  ///< what these were is not told
    Found& operator+=(const Found& more) {
      waiting += more.waiting;
      withheld += more.withheld;
      gone += more.gone;
      came_back += more.came_back;
      beside += more.beside;
      return *this;
    }
  };
  /// After an update. @param unlimited  the field without a budget
  [[nodiscard]] Found compare(const FieldSnapshot& limited, const FieldSnapshot& unlimited) {
    Found found;
    EXPECT_EQ(limited.points.size(), unlimited.points.size());
    last_told_.resize(limited.points.size(), Told::Other);
    for (std::size_t n = 0; n < limited.points.size() && !testing::Test::HasFatalFailure(); ++n) {
      compare(n, limited.points[n], unlimited.points[n], found);
    }
    return found;
  }

 private:
  enum class Told : std::uint8_t { Other, Accessible, Gone };

  void compare(std::size_t n, const SurfacePoint& told, const SurfacePoint& all, Found& found) {
    ASSERT_EQ(told.reason == PointReason::Changed, all.reason == PointReason::Changed) << n << ": " << text(told);
    if (told.reason == PointReason::Changed) {
      ASSERT_TRUE(isUnscored(told, PointReason::Changed)) << n << ": " << text(told);
      ++found.gone;
      last_told_[n] = Told::Gone;
      return;
    }
    if (isUnscored(told, PointReason::Confidence) && !isUnscored(all, PointReason::Confidence)) {
      ++found.waiting;
      found.withheld += last_told_[n] == Told::Accessible ? 1 : 0;
      found.came_back += last_told_[n] == Told::Gone ? 1 : 0;
      found.beside += all.reason == PointReason::BesideSurface ? 1 : 0;
      return;
    }
    last_told_[n] = told.label == PointLabel::Accessible ? Told::Accessible : Told::Other;
    if (!exact_) return;
    ASSERT_EQ(told.label, all.label) << n << ": " << text(told) << "; " << text(all);
    if (told.label == PointLabel::Unscored) {
      ASSERT_EQ(told.reason, all.reason) << n << ": " << text(told) << "; " << text(all);
    }
    if (told.label == PointLabel::Accessible) {
      ASSERT_TRUE(told.score == all.score && told.direction == all.direction && told.roll == all.roll) << n;
    }
  }

  bool exact_;
  std::vector<Told> last_told_;
};

/// Of stats: points that are gone are told as such, whether they wait or not.
inline void expectCounted(const WaitingModel::Found& found, const UpdateStats& stats) {
  EXPECT_GE(stats.backlog, found.waiting);
  EXPECT_LE(stats.backlog, found.waiting + found.gone);
  EXPECT_GE(stats.withheld_points, found.withheld);
  EXPECT_LE(stats.withheld_points, found.withheld + found.unsure());
}

/// A wall, a few obstacles before it, and a post that is there in scans 2 .. 7, goes, and is back from scan 16 on.
inline std::vector<Scan> postScans(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<Scan> scans(22);
  for (std::size_t s = 0; s < scans.size(); ++s) {
    const Eigen::Vector3d sensor_W(0, uniform(random, -0.2, 0.2), uniform(random, -0.2, 0.2));
    scans[s].T_W_S.translation() = sensor_W;
    const bool there = (s >= 2 && s < 8) || s >= 16;
    for (int n = 0; n < 1500; ++n) {
      const Eigen::Vector3d ray(2, uniform(random, -0.8, 0.8) - sensor_W.y(),
                                uniform(random, -0.5, 0.5) - sensor_W.z());
      const double y_at_post_m = sensor_W.y() + 0.6 * ray.y();
      double share = 1 + uniform(random, -0.005, 0.005);
      if (n % 32 == 0) share = uniform(random, 0.65, 1);
      if (there && std::abs(y_at_post_m + 0.2) < 0.15) share = 0.6 + uniform(random, -0.005, 0.005);
      scans[s].points_S.push_back((share * ray).cast<float>());
    }
  }
  return scans;
}

/// A field with a budget, and one without.
struct WaitingCase {
  const char* name;
  std::vector<ToolSpec> tools;
  FieldParams params;
  std::vector<int> budgets = {40, 200, 90, 0, 700, 30};  ///< one after the other
  /// In place of a walk or a wall: things go and come back.
  std::vector<Scan> (*scansOf)(std::uint64_t seed) = nullptr;
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
  FieldParams full = paramsAt(0.05), paper = paramsAt(0.05), profile = FieldParams::paper(0.05),
              spaced = paramsAt(0.05);
  full.change.mode = ChangeMode::Full;
  paper.update.policy = UpdatePolicy::Paper;
  profile.scoring.collision_distance_m = 0;  // with the profile's, almost nothing collides at such voxels
  profile.scoring.surface_samples = 200;
  spaced.tsdf.range_noise_m = 0.02;
  spaced.scoring.point_spacing_m = 0.05;
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner"), pencil = ToolGeometry::builtin("builtin:pencil");
  return {
      {"exact", {spec(pruner, "yaw", 0)}, paramsAt(0.05)},
      {"exact_with_collisions", {spec(pruner, "yaw", 12)}, paramsAt(0.05)},
      {"full_change", {spec(armTool(), "yaw", 5)}, full},
      {"gone_and_back", {spec(armTool(), "yaw", 5)}, full, {40, 200, 90, 30}, postScans},
      {"points_of_surface", {spec(pruner, "yaw", 12)}, spaced},
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
  WaitingModel::Found ever;
  std::uint64_t with_waiting = 0;
  std::mt19937_64 random(seed);
  WalkOptions options = shortWalk(12, 1200);
  options.seed = seed;
  const WalkGenerator walk(options);
  std::vector<Scan> scans = c.scansOf != nullptr ? c.scansOf(seed) : wallScans(seed, options.frames, 900);
  for (int frame = 0; frame < options.frames && c.scansOf == nullptr && seed % 2 != 0; ++frame) {
    const WalkFrame walked = walk.frame(frame);
    scans[static_cast<std::size_t>(frame)] = {walked.points_S, walked.T_W_S};
  }
  std::size_t turn = 0;
  for (std::size_t number = 0; number < scans.size(); ++number) {
    SCOPED_TRACE("scan " + std::to_string(number));
    const Scan& scan = scans[number];
    for (AccessibilityField* field : {&limited, &unlimited}) field->integrateScan(scan.points_S, scan.T_W_S);
    if (random() % 4 == 0) continue;
    static_cast<void>(unlimited.update());
    for (std::uint64_t again = random() % 3 + 1; again > 0; --again) {
      limited.setBudgetPoints(c.budgets[turn++ % c.budgets.size()]);
      const UpdateStats stats = limited.update();
      WaitingModel::Found found;
      for (std::size_t k = 0; k < c.tools.size(); ++k) {
        const auto of_tool = models[k].compare(limited.toolSnapshot(k), unlimited.toolSnapshot(k));
        found += of_tool;
        if (testing::Test::HasFatalFailure()) return;
      }
      expectCounted(found, stats);
      if (testing::Test::HasFailure()) return;
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
      ever += found;
    }
  }
  // Otherwise the comparisons would prove little.
  EXPECT_GT(with_waiting, 4u);
  EXPECT_GT(ever.withheld, 50u);
  if (c.params.scoring.point_spacing_m > 0) {
    EXPECT_GT(ever.beside, 20u);
  }
  if (c.scansOf != nullptr) {
    EXPECT_GT(ever.gone, 50u);
    EXPECT_GT(ever.came_back, 5u);
  }
  const FieldSnapshot now = unlimited.snapshot();
  EXPECT_GT(now.count(PointLabel::Accessible), 30u);
  EXPECT_GT(now.count(PointLabel::Blocked), 30u);
}

}  // namespace accessvdb::test
