// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A budget takes access away, and gives none: after every update its accessible points are among those of the same
/// stream in a field without a budget. Points that wait are unscored, exactly those, and the others are equal.
#include "support/waiting_points.h"

namespace accessvdb::test {
namespace {

ToldArrays viewOf(const AccessibilityField& field) {
  const auto [position, normal, stability, score, direction, weight, label, reason, count, roll] =
      field.hostView().points;
  return {{label, label + count}, {reason, reason + count}, {score, score + count}, {direction, direction + count}};
}

class WaitingPoints : public testing::TestWithParam<WaitingCase> {};

TEST_P(WaitingPoints, AreUnscoredAndTheOthersAsWithoutABudget) {
  for (std::uint64_t seed = 1; seed <= 4 && !HasFailure(); ++seed) {
    SCOPED_TRACE(seed);
    expectOnlyWithheld(GetParam(), seed, BackendKind::Cpu, viewOf);
  }
}

/// Built with the address sanitizer, this also sees a view whose memory is gone.
TEST(WaitingViews, LaterViewsOfARevisionLeaveTheFirstInPlace) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  params.update.budget_points = 40;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  for (const Scan& scan : wallScans(2, 8, 900)) field.integrateScan(scan.points_S, scan.T_W_S);
  ASSERT_GT(field.update().backlog, 0u);
  const FieldSnapshot told = field.snapshot();
  const DevicePoints first = field.hostView().points, second = field.hostView().points;
  EXPECT_TRUE(first.label == second.label && first.reason == second.reason && first.score == second.score &&
              first.direction == second.direction);
  ASSERT_EQ(first.count, told.points.size());
  for (std::size_t n = 0; n < told.points.size(); ++n) {
    ASSERT_TRUE(first.label[n] == told.points[n].label && first.reason[n] == told.points[n].reason &&
                first.score[n] == told.points[n].score)
        << n;
  }
  ASSERT_GT(field.update().backlog, 0u) << "which is another revision";
  const DevicePoints later = field.hostView().points;
  const FieldSnapshot now = field.snapshot();
  std::size_t changed = 0;
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    ASSERT_EQ(later.label[n], now.points[n].label) << n;
    changed += now.points[n].label != told.points[n].label ? 1 : 0;
  }
  EXPECT_GT(changed, 0u);
}

/// A kernel knows where a point is that was scored before and waits; of one that never was it knows nothing.
TEST(WaitingViews, HavePositionsOfPointsThatWereScored) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  const std::vector<Scan> scans = wallScans(2, 9, 900);
  std::size_t waiting = 0, unknown = 0;
  FieldSnapshot before;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    field.setBudgetPoints(n + 1 == scans.size() ? 20 : 0);
    field.integrateScan(scans[n].points_S, scans[n].T_W_S);
    static_cast<void>(field.update());
    const DeviceView view = field.hostView();
    const FieldSnapshot now = field.snapshot();
    for (std::size_t id = 0; id < now.points.size(); ++id) {
      double p_W[3];
      const bool has_position = view.positionOf(static_cast<std::uint32_t>(id), p_W);
      const bool was_scored = now.points[id].label != PointLabel::Unscored ||
                              (id < before.points.size() && before.points[id].label != PointLabel::Unscored);
      ASSERT_TRUE(has_position || !was_scored) << id;
      for (int axis = 0; axis < 3 && has_position; ++axis) ASSERT_EQ(p_W[axis], now.points[id].position_W[axis]) << id;
      waiting += was_scored && now.points[id].label == PointLabel::Unscored ? 1 : 0;
      unknown += has_position ? 0 : 1;
    }
    before = now;
  }
  EXPECT_GT(waiting, 50u);
  EXPECT_GT(unknown, 50u);
}

INSTANTIATE_TEST_SUITE_P(Streams, WaitingPoints, testing::ValuesIn(waitingCases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace accessvdb::test
