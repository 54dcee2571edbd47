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

INSTANTIATE_TEST_SUITE_P(Streams, WaitingPoints, testing::ValuesIn(waitingCases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace accessvdb::test
