// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Angles in radians.
#pragma once

#include <numbers>

namespace accessvdb::sim {

inline constexpr double kDegree = std::numbers::pi / 180, kTurn = 2 * std::numbers::pi;

}  // namespace accessvdb::sim
