// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tries every orientation at one point, each by itself, by the rules of every other evaluation.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/access_map.h"
#include "field/tools/scoring_setup.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// @param scorer  fresh: not one whose state is needed again
[[nodiscard]] std::vector<DirectionOutcome> tryEveryDirection(PointScorer& scorer, const ScoringSetup& setup,
                                                              const kernels::OccupancyGrid* grid, std::uint32_t id);

}  // namespace accessvdb::internal
