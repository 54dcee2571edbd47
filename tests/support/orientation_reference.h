// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The axes of orientation sets a second time, straight from what docs/orientations.md says, with plain cosines.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "accessvdb/params.h"

namespace accessvdb::test {

/// Outwards along the tool's body. Empty for yaw.
inline std::vector<std::array<double, 3>> referenceAxes(const ApproachParams& approach) {
  std::vector<std::array<double, 3>> axes;
  const auto add = [&](double yaw_rad, double pitch_rad) {
    axes.push_back(
        {std::cos(yaw_rad) * std::cos(pitch_rad), std::sin(yaw_rad) * std::cos(pitch_rad), std::sin(pitch_rad)});
  };
  const auto addRing = [&](int count, double pitch_deg) {
    const double pitch_rad = pitch_deg * std::numbers::pi / 180;
    for (int d = 0; d < count; ++d) add(2 * std::numbers::pi * d / count, pitch_rad);
  };
  const OrientationSet& set = approach.orientations;
  switch (set.kind) {
    case OrientationKind::Yaw:
      break;
    case OrientationKind::Pitch:
      for (double pitch_deg = set.pitch_min_deg; pitch_deg <= set.pitch_max_deg; pitch_deg += set.step_deg) {
        addRing(std::abs(pitch_deg) == 90 ? 1 : approach.num_directions, pitch_deg);
      }
      break;
    case OrientationKind::Sphere: {
      const int rings = static_cast<int>(std::floor(90 / set.step_deg + 0.5));
      for (int n = -rings; n <= rings; ++n) {
        const double pitch_deg = 90.0 * n / rings;
        const double yaws = std::floor(90 * std::cos(pitch_deg * std::numbers::pi / 180) / set.step_deg + 0.5 + 1e-9);
        addRing(std::abs(n) == rings ? 1 : 4 * std::max(1, static_cast<int>(yaws)), pitch_deg);
      }
      break;
    }
    case OrientationKind::List:
      for (const ToolOrientation& orientation : set.list) add(orientation.yaw_rad, orientation.pitch_rad);
      break;
  }
  return axes;
}

}  // namespace accessvdb::test
