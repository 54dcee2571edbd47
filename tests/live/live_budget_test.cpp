// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A live session whose updates follow the clock: the budgets that it says it used give the same bits in a field that
/// is fed directly, and once nothing waits, labels are those of a full evaluation.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "accessvdb/error.h"
#include "live/live_stream.h"

namespace accessvdb::live_test {
namespace {

constexpr std::size_t kScans = 8;
/// No step is as short, so the budget is the least that there is.
constexpr double kShort_ms = 1;

std::vector<Scan> manyPoints() { return test::wallScans(3, kScans, 4000); }

struct Fed {
  AccessibilityField field;
  std::size_t scans = 0;
  void take(const LiveStep& step, const std::vector<Scan>& all) {
    if (!step.only_backlog) {
      const auto n = static_cast<std::size_t>((step.stamp_ns - kFirst_ns) / kStep_ns);
      field.integrateScan(all[n].points_S, sentPose(poseOf(all[n], n)));
      ++scans;
    }
    if (!step.budget_points) return;
    field.setBudgetPoints(*step.budget_points);
    const UpdateStats scored = field.update();
    EXPECT_EQ(scored.backlog, step.scored.backlog);
    EXPECT_EQ(scored.backlog_updates, step.scored.backlog_updates);
    EXPECT_EQ(scored.direction_tests, step.scored.direction_tests);
  }
};

void expectLabelsOfFullEvaluation(const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  for (std::size_t n = 0; n < now.points.size(); ++n) ASSERT_EQ(now.points[n].label, scratch.points[n].label) << n;
}

/// Who only saw what changed takes no point for accessible that the field does not.
void expectNothingMoreAccessible(const std::vector<SurfacePoint>& shown, const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot();
  for (const SurfacePoint& point : shown) {
    ASSERT_TRUE(point.label != PointLabel::Accessible || now.points[point.id].label == PointLabel::Accessible)
        << point.id;
  }
}

class LiveBudget : public testing::TestWithParam<double> {};

TEST_P(LiveBudget, SaysWhichBudgetsGiveTheSameBits) {
  const std::vector<Scan> scans = manyPoints();
  for (const std::size_t update_every : {1, 3}) {
    SCOPED_TRACE(update_every);
    LiveOptions options;
    options.budget_ms = GetParam();
    options.update_every = update_every;
    LiveSession session(test::armTool(), coarseParams(), options);
    Fed fed{AccessibilityField(test::armTool(), coarseParams())};
    std::vector<SurfacePoint> shown;
    std::size_t backlog_steps = 0, without_update = 0, withheld = 0;
    std::set<int> budgets;
    bool fused = false;  // and not updated yet
    const auto stepAndCompare = [&] {
      const auto step = session.step();
      if (!step) return false;
      fed.take(*step, scans);
      expectSameField(session.field(), fed.field);
      for (const SurfacePoint& point : step->changed) {
        if (point.id >= shown.size()) shown.resize(point.id + 1);
        shown[point.id] = point;
      }
      expectNothingMoreAccessible(shown, session.field());
      backlog_steps += step->only_backlog ? 1 : 0;
      without_update += step->budget_points ? 0 : 1;
      if (step->budget_points) budgets.insert(*step->budget_points);
      const LiveStatus status = session.status();
      EXPECT_EQ(status.backlog, step->budget_points ? step->scored.backlog : status.backlog);
      EXPECT_GE(status.backlog_max, status.backlog);
      EXPECT_EQ(status.backlog_ms > 0, status.backlog > 0);
      EXPECT_EQ(status.backlog_steps, backlog_steps);
      const bool fused_before = std::exchange(fused, !step->budget_points);
      if (step->only_backlog && !fused_before && step->scored.backlog > 0) {
        EXPECT_TRUE(step->changed.empty());
      }
      EXPECT_EQ(status.withheld_points, step->budget_points ? step->scored.withheld_points : status.withheld_points);
      withheld += status.withheld_points;
      return true;
    };
    for (std::size_t n = 0; n < scans.size() && !HasFatalFailure(); ++n) {
      session.addPose(poseOf(scans[n], n));
      session.addScan(scanOf(scans[n], n));
      for (std::size_t turn = 0; turn < 3 && stepAndCompare(); ++turn) {
      }
      // Who waits is woken for points that wait, but not between the updates of update_every.
      EXPECT_EQ(session.waitForWork(std::chrono::milliseconds(0)),
                session.status().backlog > 0 && (n + 1) % update_every == 0);
    }
    session.endOfPoses();
    while (stepAndCompare() && !HasFatalFailure()) {
    }
    EXPECT_EQ(fed.scans, scans.size());
    EXPECT_EQ(session.status().taken, scans.size());
    expectAllAccountedFor(session.status());
    EXPECT_EQ(without_update, update_every == 1 ? 0U : 6U);
    // Otherwise the comparison would prove little.
    EXPECT_GT(backlog_steps, 5U);
    EXPECT_GT(session.status().backlog_max, 500U);
    EXPECT_GT(session.status().backlog_max_ms, 0);
    EXPECT_GT(withheld, 100U);
    EXPECT_EQ(session.status().withheld_points, 0U);
    EXPECT_GT(*budgets.begin(), 0);
    // At the end nothing waits, and who only ever saw what changed knows every label.
    EXPECT_EQ(session.status().backlog, 0U);
    EXPECT_EQ(session.status().backlog_ms, 0);
    EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
    test::expectVaried(session.field().snapshot());
    expectLabelsOfFullEvaluation(session.field());
    const FieldSnapshot all = session.field().snapshot();
    ASSERT_EQ(shown.size(), all.points.size());
    for (std::size_t n = 0; n < shown.size(); ++n) {
      ASSERT_EQ(shown[n].label, all.points[n].label) << n;
      ASSERT_EQ(shown[n].reason, all.points[n].reason) << n;
      ASSERT_EQ(shown[n].direction, all.points[n].direction) << n;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Times, LiveBudget, testing::Values(kShort_ms, 10.0));

TEST(LiveBudget, ThatIsLongEnoughChangesNothing) {
  const std::vector<Scan> scans = test::wallScans(3, kScans, 300);
  LiveOptions options;
  options.budget_ms = 60000;
  LiveSession session(test::armTool(), coarseParams(), options);
  for (std::size_t n = 0; n < scans.size(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    EXPECT_EQ(stepAll(session), 1U);
  }
  EXPECT_EQ(session.status().backlog_max, 0U);
  EXPECT_EQ(session.status().backlog_max_ms, 0);
  const AccessibilityField expected = fedDirectly(scans, upTo(scans.size()));
  const FieldSnapshot a = session.field().snapshot(), b = expected.snapshot();
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t n = 0; n < a.points.size(); ++n) ASSERT_EQ(a.points[n].label, b.points[n].label) << n;
}

/// Scans that wait go before points that wait.
TEST(LiveBudget, ServesScansFirst) {
  const std::vector<Scan> scans = manyPoints();
  LiveOptions options;
  options.budget_ms = kShort_ms;
  LiveSession session(test::armTool(), coarseParams(), options);
  for (std::size_t n = 0; n < 3; ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
  }
  for (std::size_t n = 0; n < 3; ++n) {
    const auto step = session.step();
    ASSERT_TRUE(step);
    EXPECT_FALSE(step->only_backlog);
    EXPECT_GT(step->scored.backlog, 0U);
  }
  const auto step = session.step();
  ASSERT_TRUE(step);
  EXPECT_TRUE(step->only_backlog);
  EXPECT_EQ(step->stamp_ns, stampOf(2));
}

TEST(LiveBudget, GoesOnAfterResetAndRemoval) {
  const std::vector<Scan> scans = manyPoints();
  LiveOptions options;
  options.budget_ms = kShort_ms;
  LiveSession session(test::armTool(), coarseParams(), options);
  const auto feed = [&](std::size_t n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    ASSERT_TRUE(session.step());
    ASSERT_GT(session.status().backlog, 0U);
  };
  feed(0);
  const LiveRemoval removal =
      session.removeRegion(Region::box(Eigen::Vector3d(1.4, 0.4, 0.3), Eigen::Vector3d(1.6, 0.6, 1.0)));
  EXPECT_GT(removal.removal.voxels, 0U);
  EXPECT_EQ(session.status().backlog, 0U) << "all points are asked again, and none of them waits";
  expectLabelsOfFullEvaluation(session.field());
  feed(1);
  session.reset();
  EXPECT_EQ(session.status().backlog, 0U);
  EXPECT_EQ(session.status().backlog_ms, 0);
  EXPECT_FALSE(session.step());
  feed(0);
  feed(1);
  while (session.step()) {
  }
  EXPECT_EQ(session.status().backlog, 0U);
  expectLabelsOfFullEvaluation(session.field());
}

/// A budget that the parameters give is worked off between scans, too, and the status tells of it.
TEST(LiveBudget, OfTheParametersIsWorkedOffWithoutAClock) {
  constexpr int kBudget = 200;
  const std::vector<Scan> scans = manyPoints();
  FieldParams params = coarseParams();
  params.update.budget_points = kBudget;
  LiveSession session(test::armTool(), params);
  Fed fed{AccessibilityField(test::armTool(), params)};
  std::vector<SurfacePoint> shown;
  std::size_t backlog_steps = 0;
  const auto stepAndCompare = [&] {
    const auto step = session.step();
    if (!step) return false;
    EXPECT_EQ(step->budget_points, kBudget);
    fed.take(*step, scans);
    expectSameField(session.field(), fed.field);
    for (const SurfacePoint& point : step->changed) {
      if (point.id >= shown.size()) shown.resize(point.id + 1);
      shown[point.id] = point;
    }
    expectNothingMoreAccessible(shown, session.field());
    backlog_steps += step->only_backlog ? 1 : 0;
    const LiveStatus status = session.status();
    EXPECT_EQ(status.budget_points, static_cast<std::uint64_t>(kBudget));
    EXPECT_EQ(status.backlog, step->scored.backlog);
    EXPECT_EQ(status.withheld_points, step->scored.withheld_points);
    EXPECT_EQ(status.backlog_ms > 0, status.backlog > 0);
    EXPECT_EQ(status.backlog_steps, backlog_steps);
    return true;
  };
  for (std::size_t n = 0; n < scans.size() && !HasFatalFailure(); ++n) {
    session.addPose(poseOf(scans[n], n));
    session.addScan(scanOf(scans[n], n));
    for (std::size_t turn = 0; turn < 2 && stepAndCompare(); ++turn) {
    }
    EXPECT_EQ(session.waitForWork(std::chrono::milliseconds(0)), session.status().backlog > 0);
  }
  EXPECT_GT(session.status().backlog, 0U) << "else nothing is left to work off";
  while (stepAndCompare() && !HasFatalFailure()) {
  }
  EXPECT_EQ(fed.scans, scans.size());
  EXPECT_GT(backlog_steps, 5U);
  EXPECT_EQ(session.status().backlog, 0U);
  EXPECT_FALSE(session.waitForWork(std::chrono::milliseconds(0)));
  expectLabelsOfFullEvaluation(session.field());
  const FieldSnapshot all = session.field().snapshot();
  ASSERT_EQ(shown.size(), all.points.size());
  for (std::size_t n = 0; n < shown.size(); ++n) {
    ASSERT_TRUE(shown[n].label == all.points[n].label && shown[n].reason == all.points[n].reason) << n;
  }
}

TEST(LiveBudget, RefusesWhatCannotBe) {
  const auto idOf = [](const LiveOptions& options, const FieldParams& params = coarseParams()) -> std::string {
    try {
      const LiveSession session(test::armTool(), params, options);
    } catch (const InvalidArgument& error) {
      return error.id();
    }
    return "";
  };
  LiveOptions options;
  for (const double bad : {-1.0, 0.5, 60001.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    options.budget_ms = bad;
    EXPECT_EQ(idOf(options), "live.budget") << bad;
  }
  options.budget_ms = 80;
  EXPECT_EQ(idOf(options), "");
  FieldParams params = coarseParams();
  params.update.budget_points = 10;
  EXPECT_EQ(idOf(options, params), "live.budget");
  options.rolling = RollingOptions{.folder = "never_made"};
  EXPECT_EQ(idOf(options), "live.budget");
  AccessibilityField field(test::armTool(), coarseParams());
  EXPECT_THROW(field.setBudgetPoints(-1), InvalidArgument);
  EXPECT_THROW(field.setBudgetPoints(2'000'000'001), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::live_test
