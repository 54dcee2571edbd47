// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Cosine and sine of the angles of orientations, exact under quarter turns: direction d + D/4 is (-sin, cos) of
/// direction d bit for bit, and d = 0, D/4, D/2, 3D/4 are exactly on the axes. Everything that rotates by a direction
/// uses this.
#pragma once

#include <cmath>
#include <numbers>

namespace accessvdb::internal {

struct CosSin {
  double cos, sin;
};

/// Cosine and sine of an angle below a quarter turn, turned by whole quarters.
inline CosSin turnedByQuarters(double angle_rad, int quarters) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  switch (quarters) {
    case 0:
      return {c, s};
    case 1:
      return {angle_rad == 0 ? 0.0 : -s, c};
    case 2:
      return {-c, angle_rad == 0 ? 0.0 : -s};
    default:
      return {s, -c};
  }
}

/// Cosine and sine of yaw 2 pi d / D, with 0 <= d < D.
inline CosSin yawDirection(int d, int num_directions) {
  const int quarter = 4 * d / num_directions, remainder = 4 * d % num_directions;
  return turnedByQuarters(0.5 * std::numbers::pi * remainder / num_directions, quarter);
}

/// The same of an angle in degrees, with the bits of yawDirection(d, 180) for 2 d degrees. @param degrees  finite
inline CosSin degreesDirection(double degrees) {
  constexpr double kTurn = 360, kQuarter = 90;
  double rest = std::fmod(degrees, kTurn) + 0.0;  // exact; never -0
  if (rest < 0) rest += kTurn;
  if (!(rest < kTurn)) rest = 0;  // the sum was rounded up
  const int quarter = static_cast<int>(rest / kQuarter);
  return turnedByQuarters(0.5 * std::numbers::pi * (rest - quarter * kQuarter) / kQuarter, quarter);
}

}  // namespace accessvdb::internal
