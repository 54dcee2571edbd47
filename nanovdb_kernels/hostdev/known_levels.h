// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What searches found out about a direction of a point, in one byte: how far its collisions exceed the number needed
/// to skip it, and whether the corridor is blocked. Eight directions share a word.
#pragma once

#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Directions per word.
inline constexpr int kKnownPerWord = 8;

/// A direction needs no test if it has more collisions than this: than an accessible point's best one, or than any that
/// makes a blocked point accessible. Levels count from here.
ACCESSVDB_HOSTDEV inline int baseCollisions(bool accessible, int score, int collision_limit) {
  return accessible ? score : collision_limit - 1;
}

/// Levels count steps of 2^log2 collisions. They are relative to a number that grows as collisions disappear
/// (FreedWord), so the levels of many points age together and by whole steps: only writing a level or changing the base
/// rounds.
struct KnownLevels {
  static constexpr std::uint32_t kMost = 127;
  /// Voxels that stopped colliding are counted up to this many steps; then levels are lowered by that.
  static constexpr std::uint32_t kMostFreedSteps = 32;

  int log2 = 0;  ///< of the collisions per step

  /// Fastest on flights with tools of a few hundred to half a million voxels: short steps, provided that levels reach
  /// several times the limit, but no shorter than the amount by which counting overshoots.
  static KnownLevels forLimit(int collision_limit) {
    constexpr int kOvershootLog2 = 3, kMostLog2 = 10;  // the highest limit, 2^16 - 1, is 64 of the longest steps
    KnownLevels levels;
    const auto atLeastSteps = [&](int steps) { return collision_limit >= steps << levels.log2; };
    while (levels.log2 < kOvershootLog2 && atLeastSteps(8)) ++levels.log2;
    while (levels.log2 < kMostLog2 && atLeastSteps(48)) ++levels.log2;
    return levels;
  }

  /// Level for `more` collisions above the base when `freed` voxels were freed. 0: nothing is known.
  ACCESSVDB_HOSTDEV std::uint32_t levelOf(int more, int freed) const {
    if (more <= 0) return 0;
    const auto level = static_cast<std::uint32_t>(more + freed) >> log2;
    return level < kMost ? level : kMost;
  }
  /// Lower bound on the collisions above the base; may be negative. @param level  not 0
  ACCESSVDB_HOSTDEV int collisionsOf(std::uint32_t level, int freed) const {
    return static_cast<int>(level << log2) - freed;
  }
};

/// Eight levels, one byte each: direction n of the word in bits 8 n .. 8 n + 6; bit 8 n + 7 = the corridor is blocked.
namespace known_word {

inline constexpr std::uint64_t kEach = 0x0101010101010101ull, kArms = kEach << 7, kLevels = ~kArms;

/// Level of direction n.
ACCESSVDB_HOSTDEV inline std::uint32_t levelIn(std::uint64_t word, int n) {
  return static_cast<std::uint32_t>(word >> (8 * n)) & KnownLevels::kMost;
}
ACCESSVDB_HOSTDEV inline std::uint64_t withLevel(std::uint64_t word, int n, std::uint32_t level) {
  return (word & ~(std::uint64_t{KnownLevels::kMost} << (8 * n))) | std::uint64_t{level} << (8 * n);
}

/// The highest bit of each byte; direction n in bit n.
ACCESSVDB_HOSTDEV inline std::uint32_t gather(std::uint64_t word) {
  const auto half = [](std::uint32_t bits) { return (bits >> 7 & 0x01010101u) * 0x01020408u >> 24 & 0xfu; };
  return half(static_cast<std::uint32_t>(word)) | half(static_cast<std::uint32_t>(word >> 32)) << 4;
}
/// The inverse: bit n to the highest bit of byte n.
ACCESSVDB_HOSTDEV inline std::uint64_t spread(std::uint32_t bits) {
  const auto half = [](std::uint32_t four) { return four * 0x00204081u & 0x01010101u; };
  return (std::uint64_t{half(bits >> 4 & 0xfu)} << 32 | half(bits & 0xfu)) << 7;
}

/// Directions that need no test, one bit each. @param lowest  the lowest levels that imply this, one byte each: 1 ..
/// 128
ACCESSVDB_HOSTDEV inline std::uint32_t worse(std::uint64_t word, std::uint64_t lowest) {
  return gather((((word & kLevels) | kArms) - lowest) | word);
}

/// Levels reduced by `steps`, but not below 0. @param steps  one byte each: 0 .. 127
ACCESSVDB_HOSTDEV inline std::uint64_t lowered(std::uint64_t word, std::uint64_t steps) {
  const std::uint64_t left = ((word & kLevels) | kArms) - steps;  // the highest bits stay where levels suffice
  const std::uint64_t enough = left >> 7 & kEach;
  return (left & ((enough << 7) - enough)) | (word & kArms);
}

/// Levels increased by `steps`, but not above the highest level; unknown levels stay unknown.
ACCESSVDB_HOSTDEV inline std::uint64_t raised(std::uint64_t word, std::uint32_t steps) {
  const std::uint64_t levels = word & kLevels;
  const std::uint64_t some = (levels + kLevels) >> 7 & kEach;  // 1 where a level is not 0
  const std::uint64_t sum = levels + some * steps;             // at most 254 per byte
  const std::uint64_t over = sum >> 7 & kEach;
  return ((sum | ((over << 7) - over)) & kLevels) | (word & kArms);
}

/// Levels relative to a base that is higher by `more`.
ACCESSVDB_HOSTDEV inline std::uint64_t rebased(std::uint64_t word, int more, int log2) {
  const std::uint32_t collisions = static_cast<std::uint32_t>(more > 0 ? more : -more);
  const std::uint32_t steps = (collisions + (more > 0 ? (1u << log2) - 1 : 0)) >> log2;  // rounds towards lower levels
  const std::uint32_t most = steps < KnownLevels::kMost ? steps : KnownLevels::kMost;
  return more > 0 ? lowered(word, kEach * most) : raised(word, most);
}

}  // namespace known_word

/// Upper bounds on the voxels that stopped colliding in each of a word's directions since levels were last lowered.
/// Counted in eighths of a step, rounded up, so that one byte suffices: whole steps are what ages levels. If a step has
/// at most eight collisions, each voxel counts.
struct FreedWord {
  std::uint64_t bytes = 0;  ///< of direction n: bits 8 n .. 8 n + 7

  /// Voxels that a unit stands for, as a power of two.
  [[nodiscard]] ACCESSVDB_HOSTDEV static int unitLog2(int log2) { return log2 > kUnitsLog2 ? log2 - kUnitsLog2 : 0; }

  /// In voxels.
  [[nodiscard]] ACCESSVDB_HOSTDEV int count(int n, int log2) const {
    return static_cast<int>(units(n) << unitLog2(log2));
  }
  /// The lowest levels that mean more collisions than the base, one byte each.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint64_t lowestWithMore(int log2) const {
    const int shift = log2 - unitLog2(log2);
    const std::uint64_t kept = known_word::kEach * (0xffu >> shift);  // without bits from the byte above
    return (bytes >> shift & kept) + known_word::kEach;
  }

  /// Adds newly freed voxels. Once one direction has kMostFreedSteps (or with `forget`), levels have to be lowered.
  /// @param more  [kKnownPerWord]; each below 2^32 - 2^8   @param forget  lower by so much that nothing stays known
  /// @param steps  out: by how much, one byte each
  /// @return whether levels have to be lowered
  ACCESSVDB_HOSTDEV bool add(const std::uint32_t* more, bool forget, int log2, std::uint64_t& steps) {
    constexpr std::uint32_t kAll = KnownLevels::kMost;
    const int unit = unitLog2(log2), shift = log2 - unit;
    bool lower = forget;
    std::uint32_t sums[kKnownPerWord];
    for (int n = 0; n < kKnownPerWord; ++n) {
      sums[n] = units(n) + ((more[n] + (1u << unit) - 1) >> unit);
      lower = lower || sums[n] >> shift >= KnownLevels::kMostFreedSteps;
    }
    steps = 0;
    for (int n = 0; n < kKnownPerWord && lower; ++n) {
      const std::uint32_t whole = sums[n] >> shift, taken = forget || whole > kAll ? kAll : whole;
      steps |= std::uint64_t{taken} << (8 * n);
      sums[n] -= whole << shift;  // beyond the highest level, nothing stays known
    }
    bytes = 0;
    for (int n = 0; n < kKnownPerWord; ++n) bytes |= std::uint64_t{sums[n]} << (8 * n);
    return lower;
  }

 private:
  static constexpr int kUnitsLog2 = 3;  ///< per step
  static_assert(KnownLevels::kMostFreedSteps << kUnitsLog2 <= 1u << 8);

  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t units(int n) const {
    return static_cast<std::uint32_t>(bytes >> (8 * n)) & 0xffu;
  }
};

}  // namespace accessvdb::kernels
