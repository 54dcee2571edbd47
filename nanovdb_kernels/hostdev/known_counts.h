// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lower bounds of a point's collisions by direction that follow each voxel that begins or ceases to collide. What a
/// voxel changes is the same for all directions of an arc: a step where it begins, and one back where it ends.
#pragma once

#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// A bound and whether the corridor is blocked, in 16 bits. The bound of an accessible point's best direction is its
/// count, or unknown.
namespace known_count {

inline constexpr std::uint16_t kArmBlocked = 0x8000;
inline constexpr std::uint16_t kUnknown = 0x7fff;  ///< stays unknown, whatever flips
inline constexpr int kMost = 0x7eff;               ///< or more
/// Most voxels that are taken together.
inline constexpr int kMostTogether = 127;
static_assert(kMost + kMostTogether < 0x7fff);

ACCESSVDB_HOSTDEV inline std::uint16_t boundOf(std::uint16_t count) {
  return static_cast<std::uint16_t>(count & ~kArmBlocked);
}
ACCESSVDB_HOSTDEV inline std::uint16_t withBound(std::uint16_t count, int bound) {
  return static_cast<std::uint16_t>((count & kArmBlocked) | (bound < kMost ? bound : kMost));
}
/// Two bounds, after so many more voxels collide, or fewer. A bound at kMost stays one. Voxels may be taken in any
/// order and in parts, so that a sum below 0 says nothing: what is still to come may be more.
/// @param counts  the first one in the lower half  @param more  the same, at most kMostTogether either way
ACCESSVDB_HOSTDEV inline std::uint32_t changedBy(std::uint32_t counts, std::uint32_t more) {
  constexpr std::uint32_t kHigh = 0x80008000u, kLow = ~kHigh, kOnes = 0x00010001u, kMosts = kMost * kOnes;
  const auto halves = [](std::uint32_t high_bits) { return (high_bits >> 15) * 0xffffu; };
  const std::uint32_t bounds = counts & kLow;
  // Halves are added without a carry between them: their highest bits apart.
  const std::uint32_t sums = (bounds + (more & kLow)) ^ (more & kHigh);
  const std::uint32_t unknown = halves((bounds + kOnes) & kHigh), below = halves(sums & kHigh),
                      above = halves(((sums & kLow) + (kLow - kMosts)) & kHigh);
  const std::uint32_t known = (sums & ~above) | (kMosts & above);
  return (counts & kHigh) | (kLow & (known | unknown | below));
}
/// After at most so many voxels ceased to collide.
ACCESSVDB_HOSTDEV inline std::uint16_t loweredBy(std::uint16_t count, int lost) {
  const std::uint16_t bound = boundOf(count);
  return bound == kUnknown ? count : withBound(count, bound > lost ? bound - lost : 0);
}
/// After a bound was found out: the larger one is left.
ACCESSVDB_HOSTDEV inline std::uint16_t learnt(std::uint16_t count, int least) {
  const std::uint16_t before = boundOf(count);
  return before != kUnknown && before > least ? count : withBound(count, least);
}

}  // namespace known_count

/// Where the step of direction d lies among those of a warp's lanes, in bytes from a lane's first one: four directions
/// to a word, a word of each lane behind the other, so that each lane has its own bank of shared memory.
ACCESSVDB_HOSTDEV inline std::uint16_t stepPlace(int d) { return static_cast<std::uint16_t>((d >> 2) * 128 + (d & 3)); }

/// The directions from one to before another, around the circle, of those whose tool covers voxels of a column; and at
/// which heights.
struct CoveringArc {
  std::uint16_t begin = 0, end = 0;        ///< stepPlace()
  std::uint8_t lowest = 255, heights = 0;  ///< ArcsView::low[2] + lowest, and so many above it

  [[nodiscard]] ACCESSVDB_HOSTDEV bool covers(std::uint32_t height) const { return height - lowest <= heights; }
};
/// All arcs of the voxels above each other at an offset: nearly always one or two.
struct alignas(16) ArcsOfColumn {
  CoveringArc first, second;
  std::uint16_t more = 0, count = 0;  ///< further ones, from ArcsView::more + more on
};
static_assert(sizeof(ArcsOfColumn) == 16);

/// The inverse of the tool: for each offset in voxels from a point, the yaws whose tool covers it.
struct ArcsView {
  /// Offsets begin so far outside of what any direction covers that no point of a block needs to ask whether a voxel in
  /// reach of another one is in its own.
  static constexpr std::int32_t kMargin = 8;
  static constexpr std::int32_t kMostSize = 1023, kMostHeight = 255;  ///< [voxels] of the box

  const ArcsOfColumn* table = nullptr;  ///< [x][y] of the box; null: there is none
  const CoveringArc* more = nullptr;
  std::int32_t low[3] = {0, 0, 0}, size[3] = {0, 0, 0};  ///< box of the offsets, with the margin
  std::int32_t reach_squared = 0;  ///< [voxels^2] the largest horizontal distance that any direction covers
};

}  // namespace accessvdb::kernels
