// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tries orientations at points, each by itself, by the rules of every other evaluation.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/access_map.h"
#include "field/tools/scoring_setup.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

class DirectionTrials {
 public:
  /// @param scorer  fresh: not one whose state is needed again  @param ids  each once
  DirectionTrials(PointScorer& scorer, const ScoringSetup& setup, const kernels::OccupancyGrid* grid,
                  std::span<const std::uint32_t> ids);

  [[nodiscard]] int directions() const { return approach_.num_directions; }
  /// Whether a direction is near enough to the normal at a point; all others are blocked.
  [[nodiscard]] bool inCone(std::uint32_t id, int direction) const;
  struct Trial {
    std::uint32_t id;
    int direction;
  };
  /// @param trials  of points of the list, each of another, and in the cone
  [[nodiscard]] std::vector<kernels::ScoreResult> tried(std::span<const Trial> trials);
  /// Every direction at every point. @return [n]
  [[nodiscard]] std::vector<std::vector<DirectionOutcome>> all(std::span<const std::uint32_t> ids);

 private:
  PointScorer& scorer_;
  const ScoringSetup& setup_;
  ScoringTables tables_;
  kernels::ApproachView approach_;
};

}  // namespace accessvdb::internal
