// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The exact policy with a budget on the GPU. The device marks more points as due than the CPU, so different ones wait;
// but at any time only waiting points differ from a full evaluation, in that they are unscored.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "support/determinism_support.h"
#include "support/waiting_points.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

struct BudgetCase {
  std::uint64_t seed;
  const char* tool;
  double voxel_size_m;
  int budget_points;
  int frames = 12;
  int rays_per_frame = 4000;
  int directions = 180;
  int max_collisions = 0;
  int scans_an_update = 1;
  ToolForm form = ToolForm::Voxels;
};
void PrintTo(const BudgetCase& c, std::ostream* out) {
  *out << c.tool << " at " << c.voxel_size_m << " m, " << c.budget_points << " points an update";
}

WalkGenerator walkOf(const BudgetCase& c) { return WalkGenerator(parityWalk(c.seed, c.frames, c.rays_per_frame)); }

FieldParams paramsOf(const BudgetCase& c, BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = c.voxel_size_m;
  params.scoring.max_collisions = c.max_collisions;
  params.scoring.form = c.form;
  params.scoring.surface_samples = 200;
  params.approach.num_directions = c.directions;
  params.update.budget_points = c.budget_points;
  params.backend = backend;
  return params;
}

bool sameAnswer(const SurfacePoint& a, const SurfacePoint& b) {
  if (a.label != b.label) return false;
  return a.label != PointLabel::Accessible || (a.score == b.score && a.direction == b.direction);
}

/// Number of points that a full evaluation of the current map labels differently.
std::uint64_t outOfDate(const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  std::uint64_t count = 0;
  for (std::size_t n = 0; n < now.points.size(); ++n) count += sameAnswer(now.points[n], scratch.points[n]) ? 0 : 1;
  return count;
}

class CudaBudget : public GpuTest, public testing::WithParamInterface<BudgetCase> {};

TEST_P(CudaBudget, OnlyDelays) {
  const BudgetCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  AccessibilityField field(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cuda));
  ASSERT_EQ(field.deviceName().rfind("cuda:", 0), 0u) << field.deviceName();
  const auto budget = static_cast<std::uint64_t>(c.budget_points);
  WaitingModel model(true);
  std::uint64_t most_waiting = 0, most_out_of_date = 0, most_withheld = 0;
  const auto update = [&](bool after_a_scan) {
    const UpdateStats stats = field.update();
    EXPECT_LE(stats.scored_points, budget);
    if (!after_a_scan) {
      EXPECT_LE(stats.dirty_points, budget);  // else it counts new neighbourhoods as well
    }
    const std::uint64_t out_of_date = outOfDate(field);
    EXPECT_LE(out_of_date, stats.backlog);
    const WaitingModel::Found found = model.compare(field.snapshot(), field.evaluateFromScratch());
    EXPECT_EQ(found.waiting, stats.backlog);
    EXPECT_EQ(found.withheld, stats.withheld_points);
    most_waiting = std::max(most_waiting, stats.backlog);
    most_out_of_date = std::max(most_out_of_date, out_of_date);
    most_withheld = std::max(most_withheld, found.withheld);
    return stats.backlog;
  };
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update == 0) update(true);
    if (HasFailure()) return;
  }
  EXPECT_GT(most_waiting, 2 * budget);
  EXPECT_GT(most_out_of_date, budget / 2);  // otherwise the bound above would prove nothing
  EXPECT_GT(most_withheld, c.frames > 5 ? 20u : 0u);
  std::uint64_t waiting = 1;
  for (int turn = 0; turn < 1000 && waiting > 0; ++turn) {
    const std::uint64_t before = waiting;
    waiting = update(false);
    if (turn > 0) {
      ASSERT_EQ(waiting, before - std::min(before, budget));  // nothing new is due
    }
  }
  EXPECT_EQ(waiting, 0u);
  EXPECT_EQ(outOfDate(field), 0u);
  expectVaried(field.snapshot());
}

/// A budget that is never reached changes nothing, though every point then goes through the queue.
TEST_P(CudaBudget, ThatIsNeverReachedChangesNothing) {
  BudgetCase c = GetParam();
  c.budget_points = 0;
  AccessibilityField cpu(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cpu));
  c.budget_points = 1'000'000;
  AccessibilityField cuda(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cuda));
  const WalkGenerator walk = walkOf(c);
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    cuda.integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(b.backlog, 0u);
    ASSERT_EQ(a.label_changes, b.label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
}

/// Before anything is scored, both backends find the same points due, and serve them in the same order.
TEST_P(CudaBudget, ServesTheFirstComersAsTheCpuDoes) {
  BudgetCase c = GetParam();
  c.budget_points = 50;  // so that they come in several turns
  AccessibilityField cpu(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cpu)),
      cuda(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cuda));
  const WalkFrame scan = walkOf(c).frame(0);
  cpu.integrateScan(scan.points_S, scan.T_W_S);
  cuda.integrateScan(scan.points_S, scan.T_W_S);
  std::uint64_t first = 0;
  for (int turn = 0; turn < 4; ++turn) {
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(a.backlog, b.backlog);
    ASSERT_EQ(a.label_changes, b.label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
    if (turn == 0) first = a.backlog;
  }
  EXPECT_GT(first, 0u);
}

/// A budget may be another one at each update, or go and come: an update without one leaves nothing waiting.
TEST_P(CudaBudget, ChangesFromUpdateToUpdate) {
  BudgetCase c = GetParam();
  const int budgets[] = {c.budget_points / 8, c.budget_points / 4, 0, c.budget_points, 1'000'000, 0, 0};
  c.budget_points = 0;
  AccessibilityField field(ToolGeometry::builtin(c.tool), paramsOf(c, BackendKind::Cuda));
  const WalkGenerator walk = walkOf(c);
  std::uint64_t waited = 0, longest = 0;
  int turn = 0;
  const auto update = [&] {
    const int budget = budgets[turn++ % std::ssize(budgets)];
    field.setBudgetPoints(budget);
    const UpdateStats stats = field.update();
    ASSERT_EQ(stats.backlog_updates > 0, stats.backlog > 0);
    if (budget == 0) {
      ASSERT_EQ(stats.backlog, 0u);
    }
    ASSERT_LE(outOfDate(field), stats.backlog);
    waited += stats.backlog > 0 ? 1 : 0;
    longest = std::max(longest, stats.backlog_updates);
  };
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    for (int n = 0; n <= frame % 2; ++n) update();
    if (HasFatalFailure()) return;
  }
  field.setBudgetPoints(0);
  EXPECT_EQ(field.update().backlog, 0u);
  EXPECT_EQ(outOfDate(field), 0u);
  EXPECT_GT(waited, 1u);
  EXPECT_GT(longest, 1u);
}

INSTANTIATE_TEST_SUITE_P(
    Streams, CudaBudget,
    testing::Values(BudgetCase{.seed = 1, .tool = "builtin:pruner", .voxel_size_m = 0.05, .budget_points = 300},
                    BudgetCase{.seed = 2, .tool = "builtin:pencil", .voxel_size_m = 0.02, .budget_points = 500},
                    BudgetCase{.seed = 3,
                               .tool = "builtin:pruner",
                               .voxel_size_m = 0.04,
                               .budget_points = 700,
                               .max_collisions = 30,
                               .scans_an_update = 2},
                    BudgetCase{.seed = 4,
                               .tool = "builtin:pruner",
                               .voxel_size_m = 0.05,
                               .budget_points = 300,
                               .frames = 8,
                               .max_collisions = 3,
                               .form = ToolForm::SurfaceSamples}));

/// Streams of the CPU's test, also for several tools, wide sets and the paper's policy.
class CudaWaiting : public GpuTest, public testing::WithParamInterface<WaitingCase> {};

TEST_P(CudaWaiting, PointsAreUnscoredAndTheOthersAsOnTheCpuWithoutABudget) {
  const auto backend = kernels::makeCudaBackend();  // only for memory
  const auto viewOf = [&](const AccessibilityField& field) {
    const DevicePoints points = field.deviceView().points;
    ToldArrays told;
    const auto fetch = [&](auto& to, const auto* from) {
      to.resize(points.count);
      backend->download(to.data(), from, to.size() * sizeof to[0]);
    };
    fetch(told.label, points.label);
    fetch(told.reason, points.reason);
    fetch(told.score, points.score);
    fetch(told.direction, points.direction);
    return told;
  };
  for (std::uint64_t seed = 1; seed <= 2 && !HasFailure(); ++seed) {
    SCOPED_TRACE(seed);
    expectOnlyWithheld(GetParam(), seed, BackendKind::Cuda, viewOf);
  }
}

INSTANTIATE_TEST_SUITE_P(Streams, CudaWaiting, testing::ValuesIn(waitingCases()),
                         [](const auto& test) { return std::string(test.param.name); });

/// More points than are processed at a time.
class CudaManyPoints : public GpuTest {
 protected:
  static constexpr std::size_t kAtATime = 1 << 17;
  static void expectSameAfterManyScans(FieldParams params) {
    WalkOptions options;
    options.frames = 12;
    options.rays_per_frame = 40000;
    options.max_range_m = 6;
    options.length_m = 2;
    const WalkGenerator walk(options);
    params.tsdf.voxel_size_m = 0.01;
    params.scoring.confidence_min = 0;
    params.approach.num_directions = 12;
    params.backend = BackendKind::Cpu;
    const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");
    AccessibilityField cpu(tool, params);
    params.backend = BackendKind::Cuda;
    AccessibilityField cuda(tool, params);
    for (const int first : {0, 10}) {
      for (int frame = first; frame < (first == 0 ? 10 : 12); ++frame) {
        const WalkFrame scan = walk.frame(frame);
        cpu.integrateScan(scan.points_S, scan.T_W_S);
        cuda.integrateScan(scan.points_S, scan.T_W_S);
      }
      const UpdateStats a = cpu.update(), b = cuda.update();
      ASSERT_EQ(a.label_changes, b.label_changes);
      EXPECT_GT(a.label_changes, first == 0 ? kAtATime : 0);  // nothing had a label before
      expectSame(cpu.snapshot(), cuda.snapshot());
    }
    expectVaried(cuda.snapshot());
  }
};

TEST_F(CudaManyPoints, ExactByAQueue) {
  FieldParams params;
  params.update.budget_points = 1'000'000;
  expectSameAfterManyScans(params);
}

TEST_F(CudaManyPoints, Paper) {
  FieldParams params;
  params.update.policy = UpdatePolicy::Paper;
  params.approach.coarse_to_fine = true;
  expectSameAfterManyScans(params);
}

// tools/gpu_suite.sh runs it under compute-sanitizer.
INSTANTIATE_TEST_SUITE_P(ShortStream, CudaBudget,
                         testing::Values(BudgetCase{.seed = 9,
                                                    .tool = "builtin:pruner",
                                                    .voxel_size_m = 0.06,
                                                    .budget_points = 100,
                                                    .frames = 3,
                                                    .rays_per_frame = 1500,
                                                    .directions = 36}));

}  // namespace
}  // namespace accessvdb::test
