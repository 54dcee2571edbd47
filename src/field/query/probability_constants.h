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
    {7.049F, -6.392F, -1.983F, -1.862F, 0.000F, -0.010F, 0.000F},  // accessible
    {4.026F, -3.516F, -1.108F, -2.029F, 0.000F, 0.010F, 1.089F},   // accessible_with_room
    {-0.091F, -0.976F, 0.000F, 0.000F, -0.143F, 0.169F, 0.000F},   // tool
    {0.309F, 0.000F, -0.707F, 0.000F, -0.195F, -0.021F, 0.000F},   // arm
    {5.678F, 0.000F, 0.000F, 1.678F, -0.355F, -0.802F, 0.000F},    // unknown
}};

}  // namespace accessvdb::internal
