// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which directions the paper tries at a point: every 20 degrees, and a window around the best direction of a point
/// nearby (paper, "Tool kernel"; docs/PAPER_MAP.md, "Scoring").
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

struct CoarseToFine {
  bool on = false;            ///< off: all directions are tried
  DirectionMask coarse = {};  ///< tried at every point
  std::int32_t window = 0;    ///< also tried: this many on either side of the best one of the nearest resolved point
  float radius_m = 0;         ///< within which that point must be
  std::int32_t num_directions = 0;

  /// @param hint  that best direction, or kNoDirection
  [[nodiscard]] ACCESSVDB_HOSTDEV DirectionMask candidates(std::uint16_t hint) const {
    if (!on) return allDirections(num_directions);
    DirectionMask mask = coarse;
    if (hint == kNoDirection) return mask;
    for (int offset = -window; offset <= window; ++offset) {
      mask.set((hint + offset + num_directions) % num_directions);
    }
    return mask;
  }
};

/// A point shares its best direction with others once that direction is free.
ACCESSVDB_HOSTDEV inline bool isResolved(std::uint16_t score, std::uint16_t direction, std::uint16_t collision_limit) {
  return score < collision_limit && direction != kNoDirection;
}

/// Distance in metres; bit for bit the same everywhere.
ACCESSVDB_HOSTDEV inline float distanceBetween_m(const float* a_L, const float* b_L) {
  const float dx = a_L[0] - b_L[0], dy = a_L[1] - b_L[1], dz = a_L[2] - b_L[2];
  return sqrtf(dx * dx + dy * dy + dz * dz);
}

}  // namespace accessvdb::kernels
