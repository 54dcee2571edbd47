// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the instruction sets with sixteen lanes share: the flags of a leaf are LeafBits, a strip is a pair of rows and
// fills a quarter of a word. Included inside a namespace by leaf_kernels.cpp after the lanes of a set, hence no include
// guard.
constexpr int kLanes = 16, kSlabStrips = 4;
/// Loaded from memory, a float fills all lanes at no cost.
constexpr bool kKeepsSlabTerms = true;
using Rows = std::uint32_t;  ///< one bit per lane
using Bits = LeafBits;
using Flips = LeafChange;
using BitWord = std::uint64_t;
using Slab = std::uint64_t;
constexpr std::size_t kBitWords = 8;

alignas(64) constexpr float kLaneZ[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7};
alignas(64) constexpr float kLaneY[16] = {0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1};
inline Floats laneZ() { return loadFloats(kLaneZ); }
inline Floats laneY() { return loadFloats(kLaneY); }

inline float magnitude(float value) { return std::fabs(value); }
inline int lowestBit(std::uint32_t bits) { return std::countr_zero(bits); }
inline int countBits(BitWord word) { return std::popcount(word); }
inline bool areNone(Mask mask) { return mask == 0; }
/// The sum of what each lane counted: here all lanes count together.
inline std::uint32_t sumOfLanes(std::uint32_t count) { return count; }
inline std::uint64_t sumOfLanes(std::uint64_t count) { return count; }

inline const Floats& ofStrip(const Floats (&of)[kSlabStrips], int strip) { return of[strip]; }
/// @param strip  of the slab
inline void setStrip(Slab& slab, int strip, Rows rows) { slab |= static_cast<std::uint64_t>(rows) << (16 * strip); }
inline void setSlab(Bits& bits, int x, Slab slab) { bits[static_cast<std::size_t>(x)] |= slab; }
/// @param strip  of the leaf
inline void setStrip(Bits& bits, int strip, Rows rows) {
  setStrip(bits[static_cast<std::size_t>(strip >> 2)], strip & 3, rows);
}
inline std::uint32_t stripsOf(const Bits& bits) { return pairsOf(bits); }

/// The pairs of a slab with any bit set.
inline std::uint32_t pairsOfSlab(std::uint64_t bits) {
  constexpr std::uint64_t kTop = 0x8000800080008000u;
  const std::uint64_t tops = (((bits & ~kTop) + ~kTop) | bits) & kTop;  // per pair: set if any of its bits is
  return static_cast<std::uint32_t>((tops >> 15) * 0x0001000200040008u >> 48) & 0xfu;
}

/// Which voxels of a leaf are in a region, and which strips have any: found slab by slab, as what was just stored in
/// parts takes long to load as a whole.
struct Inside {
  Bits slabs;  ///< only those that were added
  std::uint32_t strips = 0;
  void add(int x, Slab slab) {
    slabs[static_cast<std::size_t>(x)] = slab;
    strips |= pairsOfSlab(slab) << (4 * x);
  }
  void finish() {}
  [[nodiscard]] Rows ofStrip(int strip) const {
    return static_cast<std::uint32_t>(slabs[static_cast<std::size_t>(strip >> 2)] >> (16 * (strip & 3))) & 0xffffu;
  }
};
