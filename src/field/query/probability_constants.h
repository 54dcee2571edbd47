// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the odds of a point are made with. Printed by
///   accessvdb-lab evaluate --table fit_probability --out out/fit --device cpu
/// which fits them to simulated scenes; with other ones, kProbabilityFit (accessvdb/access_probability.h) is another.
#pragma once

#include <array>

#include "field/query/access_probability.h"

namespace accessvdb::internal {

/// By term: 1, collisions, slant, noise, observations, limit, room (ProbabilityTerms::values()).
using ProbabilityConstants = std::array<float, 7>;

/// By group.
inline constexpr std::array<ProbabilityConstants, kProbabilityGroups> kProbabilityConstants = {{
    {4, -2, -1, 0, 0, 0, 0},
    {4, -2, -1, 0, 0, 0, 0.5},
    {0, -1, 0, 0, 0, 0, 0},
    {-1, 0, 0, 0, 0, 0, 0},
    {-1, 0, 0, 0, 0, 0, 0},
    {-1, 0, 0, 0, 0, 0, 0},
}};

}  // namespace accessvdb::internal
