// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rule by which budgets follow the clock, without a clock: steps of a machine that takes a fixed time and one per
/// point.
#include "live/update_budget.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "live/backlog_times.h"

namespace accessvdb::live_test {
namespace {

using internal::BacklogTimes;
using internal::UpdateBudget;

constexpr double kTarget_ms = 80, kAim_ms = 72;

struct Machine {
  double fixed_ms, per_point_ms;
  double waited_ms = 0;

  [[nodiscard]] double step_ms(int points) const { return fixed_ms + per_point_ms * points; }
  /// Where little is left of the time that is aimed at, a quarter of it is for points, and all after a second.
  [[nodiscard]] double fitting() const {
    return std::clamp(std::max(kAim_ms - fixed_ms, kAim_ms * std::clamp(waited_ms / 1000, 0.25, 10.0)) / per_point_ms,
                      double{UpdateBudget::kLeast}, double{UpdateBudget::kMost});
  }
  void step(UpdateBudget& budget) const {
    budget.took(step_ms(budget.points()), per_point_ms * budget.points(), true, waited_ms);
  }
};

/// It comes from below or from above, never passes what fits, and stays: it cannot oscillate.
TEST(UpdateBudget, ApproachesWhatFitsFromOneSide) {
  for (const double fixed_ms : {0.0, 10.0, 40.0, 60.0, 300.0}) {
    for (const double per_point_ms : {1e-5, 1e-3, 0.0173, 1.0}) {
      const double waited_ms = fixed_ms * 20;
      const Machine machine = {fixed_ms, per_point_ms, waited_ms};
      const double fits = machine.fitting();
      for (const int first : {0, 2000, 100'000, 2'000'000'000}) {
        SCOPED_TRACE(std::to_string(fixed_ms) + " ms and " + std::to_string(per_point_ms) + " ms a point, first " +
                     std::to_string(first));
        UpdateBudget budget(kTarget_ms, first);
        const bool rises = budget.points() < fits;
        int last = budget.points();
        for (int step = 0; step < 400; ++step) {
          machine.step(budget);
          const int now = budget.points();
          if (rises) {
            ASSERT_GE(now, last);
            ASSERT_LE(now, fits * (1 + 1e-12));  // rounding
          } else {
            ASSERT_LE(now, std::max<double>(last, fits + 1e-6));  // a point up where rounding took it
            ASSERT_GE(now, static_cast<int>(fits) - 1);
          }
          last = now;
        }
        // Nearer it would have to grow by less than a point.
        EXPECT_NEAR(last, fits, 0.01 * fits + machine.step_ms(last) / (per_point_ms * fits) + 1);
      }
    }
  }
}

TEST(UpdateBudget, IsNeverZeroAndComesBack) {
  UpdateBudget budget(kTarget_ms, 10'000);
  const Machine busy = {500, 1}, free = {5, 0.01};
  for (int step = 0; step < 100; ++step) busy.step(budget);
  EXPECT_EQ(budget.points(), UpdateBudget::kLeast);
  for (int step = 0; step < 100; ++step) free.step(budget);
  EXPECT_NEAR(budget.points(), free.fitting(), 0.02 * free.fitting());
}

/// After a step that was much too long, the next ones fit again.
TEST(UpdateBudget, TakesFewStepsToFitAgain) {
  UpdateBudget budget(kTarget_ms, 2000);
  Machine machine = {30, 0.002};
  for (int step = 0; step < 100; ++step) machine.step(budget);
  EXPECT_NEAR(budget.points(), machine.fitting(), 0.02 * machine.fitting());
  machine.per_point_ms *= 4;
  int too_long = 0;
  for (int step = 0; step < 20; ++step) {
    const double ms = machine.step_ms(budget.points());
    too_long += ms > kTarget_ms ? 1 : 0;
    machine.step(budget);
  }
  EXPECT_GT(too_long, 0);
  EXPECT_LE(too_long, 2);
}

/// The longer points wait, the more are scored; up to ten times the aim.
TEST(UpdateBudget, GrowsWithTheTimeThatPointsWait) {
  int last = 0;
  for (const double waited_ms : {100.0, 600.0, 1000.0, 4000.0, 10'000.0}) {
    const Machine machine = {100, 0.02, waited_ms};
    UpdateBudget budget(kTarget_ms, 2000);
    for (int step = 0; step < 300; ++step) machine.step(budget);
    EXPECT_NEAR(budget.points(), machine.fitting(), 0.01 * machine.fitting());
    EXPECT_GT(budget.points(), last);
    last = budget.points();
  }
  const Machine machine = {100, 0.02, 1e6};
  UpdateBudget budget(kTarget_ms, 2000);
  for (int step = 0; step < 300; ++step) machine.step(budget);
  EXPECT_NEAR(budget.points(), last, 0.01 * last);
}

TEST(UpdateBudget, IsMovedLittleByOneStep) {
  UpdateBudget quick(kTarget_ms, 10'000), slow(kTarget_ms, 10'000);
  quick.took(1, 1, true);
  slow.took(60'000, 60'000, true);
  EXPECT_EQ(quick.points(), 12'500);
  EXPECT_EQ(slow.points(), 2500);
}

/// A step that scored all that was due says only that so many fit.
TEST(UpdateBudget, DoesNotGrowWhereItWasNotUsedUp) {
  UpdateBudget budget(kTarget_ms, 5000);
  for (int step = 0; step < 1000; ++step) budget.took(1, 0.5, false);
  EXPECT_EQ(budget.points(), 5000);
  budget.took(144, 0.5, false);  // nor shrinks, where it is not the reason
  EXPECT_EQ(budget.points(), 5000);
  budget.took(144, 140, false);
  EXPECT_EQ(budget.points(), 2500);
}

/// Steps of random length: single ones are too long, by no more than they differ and grow.
TEST(UpdateBudget, DoesNotAddUpNoise) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> noise(0.7, 1.3);
  const Machine machine = {20, 0.01};
  UpdateBudget budget(kTarget_ms, 2000);
  double sum_ms = 0, most_ms = 0;
  for (int step = 0; step < 2000; ++step) {
    const double all = noise(random), ms = all * machine.step_ms(budget.points());
    budget.took(ms, all * machine.per_point_ms * budget.points(), true);
    if (step < 100) continue;
    sum_ms += ms;
    most_ms = std::max(most_ms, ms);
  }
  EXPECT_NEAR(sum_ms / 1900, kAim_ms, 8);
  EXPECT_LT(most_ms, 1.8 * kTarget_ms);
}

TEST(UpdateBudget, TakesAnyTime) {
  UpdateBudget budget(1, 2000);
  for (const double ms : {0.0, -1.0, 1e300, 1e-300}) {
    for (int step = 0; step < 200; ++step) budget.took(ms, ms, true);
    EXPECT_EQ(budget.points(), ms > 1 ? UpdateBudget::kLeast : UpdateBudget::kMost) << ms;
  }
}

TEST(BacklogTimes, HaveTheOldestThatWaits) {
  const auto at = [](int ms) { return BacklogTimes::Time() + std::chrono::milliseconds(ms); };
  BacklogTimes times;
  EXPECT_FALSE(times.oldest());
  times.note(at(10), 1);
  EXPECT_EQ(times.oldest(), at(10));
  times.note(at(20), 2);
  times.note(at(30), 3);
  EXPECT_EQ(times.oldest(), at(10));
  times.note(at(40), 2);
  EXPECT_EQ(times.oldest(), at(30));
  times.note(at(50), 0);
  EXPECT_FALSE(times.oldest());
  times.note(at(60), 1);
  EXPECT_EQ(times.oldest(), at(60));
  times.clear();
  EXPECT_FALSE(times.oldest());
}

}  // namespace
}  // namespace accessvdb::live_test
