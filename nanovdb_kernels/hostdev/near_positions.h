// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Positions of points near each other as integers, so that the offsets of neighbour_rule.h between them take no
/// floating point: in fractions of a step, with what is below a fraction cut off.
///
/// An offset is rounded to whole steps, halves up. What is cut off at its end is less than a fraction, so it decides
/// nothing as long as its beginning is a whole number of fractions.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// How fine positions are.
struct PositionFractions {
  int bits = 0;          ///< behind a step; 0: positions this far apart do not fit
  double per_metre = 0;  ///< fractions per metre

  static constexpr int kMostBits = 10;

  /// @param width_steps  how far positions lie apart along an axis; less than 2^30 fractions, so that differences fit
  ///   into 32 bits with a sign
  ACCESSVDB_HOSTDEV static PositionFractions forWidth(double width_steps, double steps_per_m) {
    constexpr int kBits = 30;
    const int room = kBits - (std::ilogb(width_steps + 1) + 1);
    PositionFractions fractions;
    fractions.bits = room < 0 ? 0 : room < kMostBits ? room : kMostBits;
    fractions.per_metre = steps_per_m * static_cast<double>(1 << fractions.bits);
    return fractions;
  }

  /// @return the position, rounded down
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int64_t of(float position_m) const {
    return static_cast<std::int64_t>(std::floor(static_cast<double>(position_m) * per_metre));
  }
  /// Whether nothing is cut off.
  [[nodiscard]] ACCESSVDB_HOSTDEV bool areExactAt(float position_m) const {
    const double exactly = static_cast<double>(position_m) * per_metre;
    return std::floor(exactly) == exactly;
  }
  /// neighbourOffset() along an axis, if bits > 0. @param from, to  from the same origin; areExactAt(from)
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int32_t offset(std::int32_t from, std::int32_t to) const {
    return (to - from + (1 << (bits - 1))) >> bits;
  }
};

/// Whether neighbourOffset() is exact as far as this end is concerned, up to 500 m away: closer to zero, but not zero,
/// a float has more bits than its difference from another one keeps as a double.
ACCESSVDB_HOSTDEV inline bool hasExactOffsets(float position_m) {
  constexpr float kTiny_m = 1.0f / (1 << 20);
  return position_m == 0 || position_m >= kTiny_m || position_m <= -kTiny_m;
}

}  // namespace accessvdb::kernels
