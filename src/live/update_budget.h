// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How many points the next update may score, so that a step takes about as long as it should: the paper's adaptive
/// cap. Told how long steps took, it reads no clock itself.
///
/// If a step takes F ms whatever it scores and c ms per point, the budget approaches (aim - F) / c from one side
/// without ever passing it: B -> B aim / (F + c B) grows with B and is concave, with that as its fixed point. So it
/// cannot oscillate. Where F leaves little of the aim, scoring gets a quarter of it all the same, and more the longer
/// points have waited: else nearly all would wait without end, while the map is kept up to date for them. With that
/// time for scoring S, the fixed point is S / c, and the same holds.
#pragma once

#include <algorithm>

namespace accessvdb::internal {

class UpdateBudget {
 public:
  static constexpr int kLeast = 256;  ///< some milliseconds on any machine; never zero, which is no limit
  static constexpr int kMost = 1'000'000'000;
  static constexpr double kShareAimedAt = 0.9;          ///< of the time that there is: steps differ
  static constexpr double kLeastShareOfScoring = 0.25;  ///< of the aim
  static constexpr double kShareOfWaiting = 1e-3;       ///< the same, per ms: after a second all of it
  static constexpr double kMostShareOfScoring = 10;
  static constexpr double kMostGrowth = 1.25;  ///< at a time, since one quick step proves little
  static constexpr double kMostShrinking = 4;  ///< at a time, since one slow step proves as little

  /// @param target_ms  above 0
  UpdateBudget(double target_ms, int first_points)
      : aim_ms_(kShareAimedAt * target_ms), points_(std::clamp(first_points, kLeast, kMost)) {}

  [[nodiscard]] int points() const { return points_; }

  /// @param ms         of a step whose update had points()
  /// @param score_ms   of it, UpdateStats::score_ms
  /// @param used_up    points were left: more would have taken longer
  /// @param waited_ms  since when the oldest of them waits
  void took(double ms, double score_ms, bool used_up, double waited_ms = 0) {
    const double share = std::clamp(kShareOfWaiting * waited_ms, kLeastShareOfScoring, kMostShareOfScoring);
    const double wanted_ms = std::max(aim_ms_, ms - score_ms + share * aim_ms_);
    const double fits = wanted_ms / std::max(1e-3, ms);
    if (fits >= 1 && !used_up) return;  // how many more would have fitted is not known
    const double next = points_ * std::clamp(fits, 1 / kMostShrinking, kMostGrowth);
    // Whole points, rounded down: with a fraction that steps do not see it would go up and down by one.
    points_ = static_cast<int>(std::clamp<double>(next, kLeast, kMost));
  }

 private:
  double aim_ms_;
  int points_;
};

}  // namespace accessvdb::internal
