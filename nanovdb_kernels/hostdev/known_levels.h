// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What searches found out about a direction of a point, in a byte: a number of collisions more than would have to be
/// known to leave it out, and whether the corridor is blocked. Eight directions share a word.
#pragma once

#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Directions of a word.
inline constexpr int kKnownPerWord = 8;

/// A direction needs no test as long as it collides more often than this: an accessible point's best one, or any that
/// makes a blocked point accessible. Levels count from here.
ACCESSVDB_HOSTDEV inline int baseCollisions(bool accessible, int score, int collision_limit) {
  return accessible ? score : collision_limit - 1;
}

/// Levels are steps of as many collisions. What they are counted from is a number that grows as collisions are lost
/// (FreedWord), so that all levels of many points age at once and by whole steps: only writing one rounds, and another
/// base.
struct KnownLevels {
  static constexpr std::uint32_t kMost = 127;
  /// Voxels that ceased to collide are counted up to as many steps; then levels are lowered by them.
  static constexpr std::uint32_t kMostFreedSteps = 32;

  int log2 = 0;  ///< of the collisions of a step

  /// What pays, measured on flights with tools of a few hundred to half a million voxels: short steps, as long as
  /// levels reach several times the limit, and not shorter than what counting overshoots by.
  static KnownLevels forLimit(int collision_limit) {
    constexpr int kOvershootLog2 = 3, kMostLog2 = 10;  // kMostFreedSteps of the longest fit into 16 bits
    KnownLevels levels;
    const auto atLeastSteps = [&](int steps) { return collision_limit >= steps << levels.log2; };
    while (levels.log2 < kOvershootLog2 && atLeastSteps(8)) ++levels.log2;
    while (levels.log2 < kMostLog2 && atLeastSteps(48)) ++levels.log2;
    return levels;
  }

  /// Of so many collisions more than the base, when so many voxels were freed. 0: nothing is known.
  ACCESSVDB_HOSTDEV std::uint32_t levelOf(int more, int freed) const {
    if (more <= 0) return 0;
    const auto level = static_cast<std::uint32_t>(more + freed) >> log2;
    return level < kMost ? level : kMost;
  }
  /// At least so many collisions more than the base, or fewer than none. @param level  not 0
  ACCESSVDB_HOSTDEV int collisionsOf(std::uint32_t level, int freed) const {
    return static_cast<int>(level << log2) - freed;
  }
};

/// Eight levels, a byte each, direction n of the word in bits 8 n .. 8 n + 6; bit 8 n + 7 = the corridor is blocked.
namespace known_word {

inline constexpr std::uint64_t kEach = 0x0101010101010101ull, kArms = kEach << 7, kLevels = ~kArms;

/// Level of direction n.
ACCESSVDB_HOSTDEV inline std::uint32_t levelIn(std::uint64_t word, int n) {
  return static_cast<std::uint32_t>(word >> (8 * n)) & KnownLevels::kMost;
}
ACCESSVDB_HOSTDEV inline std::uint64_t withLevel(std::uint64_t word, int n, std::uint32_t level) {
  return (word & ~(std::uint64_t{KnownLevels::kMost} << (8 * n))) | std::uint64_t{level} << (8 * n);
}

/// The highest bits of the bytes, direction n in bit n.
ACCESSVDB_HOSTDEV inline std::uint32_t gather(std::uint64_t word) {
  const auto half = [](std::uint32_t bits) { return (bits >> 7 & 0x01010101u) * 0x01020408u >> 24 & 0xfu; };
  return half(static_cast<std::uint32_t>(word)) | half(static_cast<std::uint32_t>(word >> 32)) << 4;
}
/// The inverse: bit n in the highest bit of byte n.
ACCESSVDB_HOSTDEV inline std::uint64_t spread(std::uint32_t bits) {
  const auto half = [](std::uint32_t four) { return four * 0x00204081u & 0x01010101u; };
  return (std::uint64_t{half(bits >> 4 & 0xfu)} << 32 | half(bits & 0xfu)) << 7;
}

/// Directions that need no test, a bit each. @param lowest  the lowest levels that say so, a byte each: 1 .. 128
ACCESSVDB_HOSTDEV inline std::uint32_t worse(std::uint64_t word, std::uint64_t lowest) {
  return gather((((word & kLevels) | kArms) - lowest) | word);
}

/// Levels that are so much lower, but not below 0. @param steps  a byte each: 0 .. 127
ACCESSVDB_HOSTDEV inline std::uint64_t lowered(std::uint64_t word, std::uint64_t steps) {
  const std::uint64_t left = ((word & kLevels) | kArms) - steps;  // the highest bits stay where enough was there
  const std::uint64_t enough = left >> 7 & kEach;
  return (left & ((enough << 7) - enough)) | (word & kArms);
}

/// Levels that are so much higher, but not above the highest one; where nothing is known, nothing is.
ACCESSVDB_HOSTDEV inline std::uint64_t raised(std::uint64_t word, std::uint32_t steps) {
  const std::uint64_t levels = word & kLevels;
  const std::uint64_t some = (levels + kLevels) >> 7 & kEach;  // 1 where a level is not 0
  const std::uint64_t sum = levels + some * steps;             // of a byte at most 254
  const std::uint64_t over = sum >> 7 & kEach;
  return ((sum | ((over << 7) - over)) & kLevels) | (word & kArms);
}

/// Levels once more, counted from a base that is higher by `more`.
ACCESSVDB_HOSTDEV inline std::uint64_t rebased(std::uint64_t word, int more, int log2) {
  const std::uint32_t collisions = static_cast<std::uint32_t>(more > 0 ? more : -more);
  const std::uint32_t steps = (collisions + (more > 0 ? (1u << log2) - 1 : 0)) >> log2;  // rather too low
  const std::uint32_t most = steps < KnownLevels::kMost ? steps : KnownLevels::kMost;
  return more > 0 ? lowered(word, kEach * most) : raised(word, most);
}

}  // namespace known_word

/// Voxels that ceased to collide in the tool at each of a word's directions, at most, since levels were last lowered.
struct alignas(16) FreedWord {
  /// Direction 2 i in the lower 16 bits of the i-th, 2 i + 1 above.
  std::uint32_t pairs[kKnownPerWord / 2] = {};

  [[nodiscard]] ACCESSVDB_HOSTDEV int count(int n) const {
    return static_cast<int>(pairs[n >> 1] >> (16 * (n & 1)) & 0xffffu);
  }
  /// The lowest levels that say: more than the base. A byte each.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint64_t lowestWithMore(int log2) const {
    constexpr std::uint32_t kSteps = (2 * KnownLevels::kMostFreedSteps - 1) * 0x00010001u;
    const auto two = [&](std::uint32_t pair) {
      const std::uint32_t steps = pair >> log2 & kSteps;  // what came down from the upper half is above that
      return (steps | steps >> 8) & 0xffffu;
    };
    const std::uint32_t low = two(pairs[0]) | two(pairs[1]) << 16, high = two(pairs[2]) | two(pairs[3]) << 16;
    return (std::uint64_t{high} << 32 | low) + known_word::kEach;
  }

  /// Adds what was freed since. Once it is kMostFreedSteps in one direction (or `forget`), levels have to be lowered.
  /// @param more  [kKnownPerWord]; each below 2^32 - 2^16   @param forget  so much that nothing is known any more
  /// @param steps  out: by how much, a byte each
  /// @return whether they have to be
  ACCESSVDB_HOSTDEV bool add(const std::uint32_t* more, bool forget, int log2, std::uint64_t& steps) {
    constexpr std::uint32_t kAll = KnownLevels::kMost;
    bool lower = forget;
    std::uint32_t sums[kKnownPerWord];
    for (int n = 0; n < kKnownPerWord; ++n) {
      sums[n] = static_cast<std::uint32_t>(count(n)) + more[n];
      lower = lower || sums[n] >> log2 >= KnownLevels::kMostFreedSteps;
    }
    steps = 0;
    for (int n = 0; n < kKnownPerWord && lower; ++n) {
      const std::uint32_t whole = sums[n] >> log2, taken = forget || whole > kAll ? kAll : whole;
      steps |= std::uint64_t{taken} << (8 * n);
      sums[n] -= whole << log2;  // where that is more than the highest level, nothing is known any more
    }
    for (int i = 0; i < kKnownPerWord / 2; ++i) pairs[i] = sums[2 * i] | sums[2 * i + 1] << 16;
    return lower;
  }
};

}  // namespace accessvdb::kernels
