// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a search found out about a direction of a point, in four bits: at least how often the tool collides there more
/// than would have to be known to leave it out, or that the corridor is blocked. Eight directions share a word.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Directions of a word.
inline constexpr int kKnownPerWord = 8;

/// In this many collisions levels above the limit are counted: so many that a few frames of voxels that cease to
/// collide do not use them up, and not so many that they are hard to find.
ACCESSVDB_HOSTDEV inline int marginCollisions(int collision_limit) {
  constexpr int kLeast = 16, kMost = 4096;
  return collision_limit < kLeast ? kLeast : collision_limit < kMost ? collision_limit : kMost;
}

/// A direction needs no test as long as it collides more often than this: an accessible point's best one, or any that
/// makes a blocked point accessible. Levels count from here.
ACCESSVDB_HOSTDEV inline int baseCollisions(bool accessible, int score, int collision_limit) {
  return accessible ? score : collision_limit - 1;
}

/// Level 0: nothing is known. Levels 1 .. 14: at least this many collisions more than the base. Level 15: the corridor
/// is blocked.
struct KnownLevels {
  static constexpr std::uint32_t kArmBlocked = 15;
  std::uint16_t least[16] = {};  ///< ascending; that of kArmBlocked is above all

  /// From a single one, as many tools' best directions have few, to several times what decides; each by the same factor
  /// more than the one below.
  static KnownLevels of(int collision_limit) {
    const double factor = std::pow(8.0 * marginCollisions(collision_limit), 1.0 / (kArmBlocked - 2));
    KnownLevels levels;
    double next = 1;
    for (std::uint32_t level = 1; level < kArmBlocked; ++level, next *= factor) {
      const auto rounded = static_cast<std::uint16_t>(std::lround(next));
      const auto above = static_cast<std::uint16_t>(levels.least[level - 1] + 1);
      levels.least[level] = rounded > above ? rounded : above;
    }
    levels.least[kArmBlocked] = 0xffff;
    return levels;
  }

  /// The highest level that so many collisions more than the base reach; 0 where there are none.
  ACCESSVDB_HOSTDEV std::uint32_t levelOf(int more) const { return more > 0 ? firstAbove(more) - 1 : 0; }
  /// The lowest level that says: at least so many more, or the corridor is blocked. @param more  at least 1
  ACCESSVDB_HOSTDEV std::uint32_t lowestWith(int more) const { return firstAbove(more - 1); }

 private:
  /// The first of the levels 0 .. 14 above `collisions`, else 15.
  ACCESSVDB_HOSTDEV std::uint32_t firstAbove(int collisions) const {
    std::uint32_t first = 0;
    for (std::uint32_t step = 8; step != 0; step /= 2) {
      if (static_cast<int>(least[first + step - 1]) <= collisions) first += step;
    }
    return first;
  }
};

/// Level of direction n of a word.
ACCESSVDB_HOSTDEV inline std::uint32_t levelIn(std::uint32_t word, int n) { return word >> (4 * n) & 15u; }
ACCESSVDB_HOSTDEV inline std::uint32_t withLevel(std::uint32_t word, int n, std::uint32_t level) {
  return (word & ~(15u << (4 * n))) | level << (4 * n);
}

/// Directions of a word whose level is at least `level` (1 .. 15), a bit each.
ACCESSVDB_HOSTDEV inline std::uint32_t atLeastLevel(std::uint32_t word, std::uint32_t level) {
  // A byte a direction: adding 128 - level carries into the highest bit where there is enough.
  constexpr std::uint32_t kLow = 0x0f0f0f0fu, kHigh = 0x80808080u;
  const std::uint32_t add = (128u - level) * 0x01010101u;
  const std::uint32_t even = ((word & kLow) + add) & kHigh, odd = ((word >> 4 & kLow) + add) & kHigh;
  // Bits 0, 8, 16, 24 to 24, 26, 28, 30.
  constexpr std::uint32_t kGather = 1u << 24 | 1u << 18 | 1u << 12 | 1u << 6;
  return ((even >> 7) * kGather >> 24 & 0x55u) | ((odd >> 7) * kGather >> 24 & 0x55u) << 1;
}

}  // namespace accessvdb::kernels
