// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Cosine and sine of a yaw step, exact under quarter turns: direction d + D/4 is (-sin, cos) of direction d bit for
/// bit, and d = 0, D/4, D/2, 3D/4 are exactly on the axes. Everything that rotates by a direction uses this.
#pragma once

#include <cmath>
#include <numbers>

namespace accessvdb::internal {

struct CosSin {
  double cos, sin;
};

/// Cosine and sine of yaw 2 pi d / D, with 0 <= d < D.
inline CosSin yawDirection(int d, int num_directions) {
  const int quarter = 4 * d / num_directions, remainder = 4 * d % num_directions;
  const double angle_rad = 0.5 * std::numbers::pi * remainder / num_directions;
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  switch (quarter) {
    case 0:
      return {c, s};
    case 1:
      return {remainder == 0 ? 0.0 : -s, c};
    case 2:
      return {-c, remainder == 0 ? 0.0 : -s};
    default:
      return {s, -c};
  }
}

}  // namespace accessvdb::internal
