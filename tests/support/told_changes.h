// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Random streams of everything that can change what is told of a point, and what changed by comparing all points.
#pragma once

#include <gtest/gtest.h>

#include <ostream>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/region.h"
#include "accessvdb/tool_spec.h"
#include "field/field_access.h"
#include "points/points_as_told.h"
#include "support/determinism_support.h"

namespace accessvdb::test {

struct ToldCase {
  const char* name;
  ChangeMode change = ChangeMode::Block;
  UpdatePolicy policy = UpdatePolicy::Exact;
  int tools = 1;
  bool budgets = false, limits = false, removes = false;
};
inline std::ostream& operator<<(std::ostream& out, const ToldCase& what) { return out << what.name; }

inline std::vector<ToldCase> toldCases() {
  return {{"Plain"},
          {.name = "Still", .change = ChangeMode::Off},
          {.name = "Changing", .change = ChangeMode::Full, .removes = true},
          {.name = "Paper", .change = ChangeMode::Off, .policy = UpdatePolicy::Paper},
          {.name = "Budgets", .budgets = true},
          {.name = "Limits", .limits = true},
          {.name = "Removals", .removes = true},
          {.name = "RemovalsWithBudgets", .budgets = true, .removes = true},
          {.name = "SeveralTools", .tools = 3, .budgets = true},
          {.name = "SeveralToolsAndRemovals", .change = ChangeMode::Full, .tools = 3, .limits = true, .removes = true}};
}

/// What was seen of each kind; a test that saw none proves nothing.
struct ToldTally {
  std::size_t asked = 0, changed = 0, unchanged = 0, became_gone = 0, came_back = 0, withheld = 0;
};

inline AccessibilityField fieldOf(const ToldCase& what, BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.backend = backend;
  params.change.mode = what.change;
  params.update.policy = what.policy;
  std::vector<ToolSpec> tools = {{armTool(), OrientationSet::yaw(), 0, "arm", 40}};
  // One that is about as often as near to reaching, so that scores alone decide between the two; and one that rolls.
  if (what.tools > 1) tools.push_back({ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 0, "pruner", 6});
  if (what.tools > 2)
    tools.push_back({ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(30), 4, "pencil", -1});
  return AccessibilityField(tools, params);
}

/// Asks for changes now and then; each time, what a comparison of all points with those of the time before gives.
inline void expectToldAsCompared(const ToldCase& what, std::uint64_t seed, BackendKind backend, ToldTally& tally) {
  std::mt19937_64 random(seed);
  AccessibilityField field = fieldOf(what, backend);
  internal::PointsAsTold all(what.tools > 1);
  constexpr int kScans = 14;
  const std::vector<Scan> scans = wallScans(seed, kScans, 350);
  const auto one_in = [&](unsigned n) { return random() % n == 0; };
  std::vector<SurfacePoint> before;
  for (int n = 0; n < kScans && !testing::Test::HasFailure(); ++n) {
    SCOPED_TRACE(n);
    // Places come again, so that what has gone may come back.
    const Scan& scan = scans[static_cast<std::size_t>(n > 4 && one_in(2) ? random() % 5 : static_cast<unsigned>(n))];
    field.integrateScan(scan.points_S, scan.T_W_S, 0.1 * n);
    if (what.budgets) field.setBudgetPoints(one_in(3) ? 0 : static_cast<int>(random() % 300));
    if (!one_in(4)) static_cast<void>(field.update());
    const Eigen::Vector3d centre_W(1.5 + uniform(random, 0, 0.5), uniform(random, -0.3, 1.3),
                                   uniform(random, 0.5, 1.5));
    if (what.removes && n > 2 && one_in(3)) {
      const Eigen::Vector3d half(0.3, 0.3, 0.3);
      static_cast<void>(field.removeRegion(Region::box(centre_W - half, centre_W + half),
                                           one_in(2) ? RemovedAs::Free : RemovedAs::Unknown));
      if (one_in(2)) static_cast<void>(field.update());
    }
    if (what.limits && n > 3 && one_in(4)) {
      const std::vector<Eigen::Vector3d> centres = {centre_W};
      field.leaveOut(centres, 0.2);
    }
    if (what.limits && n == 8) field.stopGrowing();
    if (one_in(3)) continue;
    const std::vector<SurfacePoint> told = internal::FieldAccess::takeChanged(field);
    const auto points = field.points();
    const std::vector<SurfacePoint> compared = all.since(*points, static_cast<std::uint32_t>(points->size()));
    ASSERT_EQ(told.size(), compared.size());
    for (std::size_t k = 0; k < told.size(); ++k) {
      ASSERT_EQ(told[k].id, compared[k].id) << k;
      ASSERT_TRUE(sameVerdict(told[k], compared[k])) << text(told[k]) << "; " << text(compared[k]);
      ASSERT_EQ(told[k].tools, compared[k].tools) << k;
      ASSERT_EQ(told[k].position_W, compared[k].position_W) << k;
      const bool is_gone = told[k].reason == PointReason::Changed;
      const bool was_gone = told[k].id < before.size() && before[told[k].id].reason == PointReason::Changed;
      tally.became_gone += is_gone && !was_gone ? 1 : 0;
      tally.came_back += was_gone && !is_gone ? 1 : 0;
      tally.withheld += told[k].label == PointLabel::Unscored && told[k].id < before.size() &&
                                before[told[k].id].label != PointLabel::Unscored
                            ? 1
                            : 0;
    }
    ++tally.asked;
    tally.changed += told.size();
    tally.unchanged += points->size() - told.size();
    before.clear();
    for (std::size_t k = 0; k < points->size(); ++k) before.push_back(points->at(k));
  }
}

inline void expectAllKinds(const ToldCase& what, const ToldTally& tally) {
  EXPECT_GT(tally.asked, 10u);
  EXPECT_GT(tally.changed, 200u);
  EXPECT_GT(tally.unchanged, 10000u);
  if (what.removes) {
    EXPECT_GT(tally.became_gone, 10u);
    EXPECT_GT(tally.came_back, 10u);
  }
  if (what.budgets || what.limits) {
    EXPECT_GT(tally.withheld, 10u);
  }
}

}  // namespace accessvdb::test
