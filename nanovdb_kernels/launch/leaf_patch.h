// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bits of a mirrored leaf, switched in place: only the nonzero words of a change are transferred.
///
/// The previous contents of a leaf are read where it is written, so no second copy is needed.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "accessvdb/leaf_change.h"
#include "hostdev/cell_counts.h"

namespace accessvdb::kernels {

/// Words of a leaf from this offset on: eight of arm_free (active), eight of collides (value), the cell counts.
inline constexpr std::size_t kLeafBitsBytes = offsetof(OccupancyLeaf::DataType, mValueMask);
inline constexpr std::uint32_t kLeafWords = 16;
static_assert(offsetof(OccupancyLeaf::DataType, mValues) == kLeafBitsBytes + 64);
static_assert(kCellCountsBytes == kLeafBitsBytes + kLeafWords * 8);

/// What the words of a patch are: 8 B of bits, or 64 B of distances (distance_patch.h).
enum class PatchKind : std::uint32_t { Bits, Distances };
constexpr std::uint32_t wordBytes(PatchKind kind) { return kind == PatchKind::Bits ? 8 : 64; }

/// One leaf's switched bits. Bit n of `mask`: word n has bits to set; bit 16 + n: bits to clear. The words themselves
/// are in the order of the mask's bits, starting at `first_word`, in a list that patches share.
struct LeafPatch {
  static constexpr std::uint32_t kMostWords = 32;
  static constexpr std::uint32_t kUnit = 32;  ///< nodes are aligned to this many bytes
  std::uint32_t leaf = 0;                     ///< the leaf's position in the arena, in units
  std::uint32_t mask = 0;                     ///< 0: nothing to do
  std::uint32_t first_word = 0;
};

/// Clearing wins over setting.
ACCESSVDB_HOSTDEV inline std::uint64_t switched(std::uint64_t bits, std::uint64_t on, std::uint64_t off) {
  return (bits | on) & ~off;
}

/// The four sets of a change, in the order of a patch's mask.
inline std::array<const LeafBits*, 4> bitsInOrder(const LeafChange& change) {
  return {&change.arm_free_on, &change.collides_on, &change.arm_free_off, &change.collides_off};
}

/// @return LeafPatch::mask of the change
inline std::uint32_t maskOf(const LeafChange& change) {
  std::uint32_t mask = 0, bit = 0;
  for (const LeafBits* bits : bitsInOrder(change)) {
    for (const std::uint64_t word : *bits) mask |= std::uint32_t{word != 0} << bit++;
  }
  return mask;
}

/// @param words  out: one per set bit of `mask`. @return one past the last
inline std::uint64_t* copyWords(const LeafChange& change, std::uint32_t mask, std::uint64_t* words) {
  for (const LeafBits* bits : bitsInOrder(change)) {
    for (std::size_t n = 0; n < 8; ++n, mask >>= 1) {
      if ((mask & 1) != 0) *words++ = (*bits)[n];
    }
  }
  return words;
}

/// @param bits  [17] of a leaf, starting at kLeafBitsBytes. @return how many of its words changed, without the counts
inline std::uint32_t switchBits(std::uint64_t* bits, const LeafChange& change) {
  const auto sets = bitsInOrder(change);
  std::uint32_t changed = 0, changed_collides = 0;
  for (std::size_t n = 0; n < kLeafWords; ++n) {
    const std::uint64_t after = switched(bits[n], (*sets[n / 8])[n % 8], (*sets[2 + n / 8])[n % 8]);
    const std::uint32_t one = after != bits[n] ? 1 : 0;
    changed += one;
    if (n >= 8) changed_collides += one;
    bits[n] = after;
  }
  if (changed_collides != 0) bits[kLeafWords] = countCells(bits + 8);
  return changed;
}

}  // namespace accessvdb::kernels
