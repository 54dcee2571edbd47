// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The 32 lanes of a warp, in the terms of hostdev/leaf_kernels_body.h: one voxel per thread. All threads of the warp
/// call everything.
///
/// A strip is four rows, half a slab. The flags of a leaf are spread over the lanes, each of which has those of its own
/// voxels, a bit per strip: so no flag is exchanged between lanes until a leaf is written.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/search/warp.cuh"
#include "hostdev/leaf_sums.h"
#include "hostdev/return_ray.h"
#include "hostdev/vote_rule.h"

#define ACCESSVDB_KERNEL __device__ __forceinline__
#define ACCESSVDB_KERNEL_INLINE ACCESSVDB_KERNEL

namespace accessvdb::kernels::warp_lanes {

constexpr int kLanes = 32, kSlabStrips = 2, kStrips = 16;
/// Computing them again takes less than an array whose index varies.
constexpr bool kKeepsSlabTerms = false;
using Floats = float;
using Ints = std::int32_t;
struct Flag {
  bool on;
};
using Mask = Flag;
using Rows = Flag;
using BitWord = std::uint32_t;  ///< of one lane: a bit per strip
using Slab = std::uint32_t;     ///< of one lane: a bit per strip of the slab
constexpr std::size_t kBitWords = 1;
struct Bits {
  BitWord of_lane = 0;
  ACCESSVDB_HOSTDEV BitWord& operator[](std::size_t) { return of_lane; }
  ACCESSVDB_HOSTDEV const BitWord& operator[](std::size_t) const { return of_lane; }
};
struct Votes {
  Bits bit[3];
};
struct Flips {
  Bits collides_on, collides_off, arm_free_on, arm_free_off;
};
using ScanVerdict = VerdictOf<Bits>;
using LeafTarget = LeafTargetOf<Bits, BitWord, Votes>;
using AgedFacts = AgedFactsOf<Bits>;

ACCESSVDB_KERNEL unsigned ownLane() { return threadIdx.x % kWarp; }

ACCESSVDB_KERNEL Floats all(float value) { return value; }
ACCESSVDB_KERNEL Ints allInts(std::int32_t value) { return value; }
ACCESSVDB_KERNEL Floats laneZ() { return static_cast<float>(ownLane() & 7); }
ACCESSVDB_KERNEL Floats laneY() { return static_cast<float>(ownLane() >> 3); }
ACCESSVDB_KERNEL Ints loadInts(const std::uint32_t* from) { return static_cast<std::int32_t>(from[ownLane()]); }
ACCESSVDB_KERNEL void store(std::uint32_t* to, Ints a) { to[ownLane()] = static_cast<std::uint32_t>(a); }
ACCESSVDB_KERNEL Floats add(Floats a, Floats b) { return a + b; }
ACCESSVDB_KERNEL Floats sub(Floats a, Floats b) { return a - b; }
ACCESSVDB_KERNEL Floats mul(Floats a, Floats b) { return a * b; }
ACCESSVDB_KERNEL Floats div(Floats a, Floats b) { return a / b; }
ACCESSVDB_KERNEL Floats squareRoot(Floats a) { return sqrtf(a); }
ACCESSVDB_KERNEL Floats least(Floats a, Floats b) { return a < b ? a : b; }
ACCESSVDB_KERNEL Floats most(Floats a, Floats b) { return a > b ? a : b; }
ACCESSVDB_KERNEL Floats absolute(Floats a) { return fabsf(a); }
ACCESSVDB_KERNEL float magnitude(float value) { return fabsf(value); }
ACCESSVDB_KERNEL Ints truncate(Floats a) { return static_cast<std::int32_t>(a); }
ACCESSVDB_KERNEL Floats toFloats(Ints a) { return static_cast<float>(a); }
ACCESSVDB_KERNEL Ints addInts(Ints a, Ints b) { return a + b; }
ACCESSVDB_KERNEL Ints subInts(Ints a, Ints b) { return a - b; }
ACCESSVDB_KERNEL Ints mulInts(Ints a, Ints b) { return a * b; }
ACCESSVDB_KERNEL Ints leastInts(Ints a, Ints b) { return a < b ? a : b; }
ACCESSVDB_KERNEL Ints mostInts(Ints a, Ints b) { return a > b ? a : b; }
ACCESSVDB_KERNEL Ints bitAnd(Ints a, Ints b) { return a & b; }
ACCESSVDB_KERNEL Ints bitOr(Ints a, Ints b) { return a | b; }
ACCESSVDB_KERNEL Ints shiftLeft(Ints a, unsigned count) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) << count);
}
ACCESSVDB_KERNEL Ints shiftRight(Ints a, unsigned count) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) >> count);
}
ACCESSVDB_KERNEL Ints choose(Rows rows, Ints yes, Ints no) { return rows.on ? yes : no; }

ACCESSVDB_KERNEL Rows operator&(Rows a, Rows b) { return {a.on && b.on}; }
ACCESSVDB_KERNEL Rows operator|(Rows a, Rows b) { return {a.on || b.on}; }
ACCESSVDB_KERNEL Rows operator~(Rows a) { return {!a.on}; }
ACCESSVDB_KERNEL Rows& operator|=(Rows& a, Rows b) { return a = a | b; }
ACCESSVDB_KERNEL Mask greater(Floats a, Floats b) { return {a > b}; }
ACCESSVDB_KERNEL Mask atMost(Floats a, Floats b) { return {a <= b}; }
ACCESSVDB_KERNEL Mask greater(Mask among, Floats a, Floats b) { return among & greater(a, b); }
ACCESSVDB_KERNEL Mask atMost(Mask among, Floats a, Floats b) { return among & atMost(a, b); }
ACCESSVDB_KERNEL Rows lessInts(Ints a, Ints b) { return {a < b}; }

ACCESSVDB_KERNEL int lowestBit(std::uint32_t bits) { return __ffs(static_cast<int>(bits)) - 1; }
ACCESSVDB_KERNEL int countBits(BitWord word) { return __popc(word); }
ACCESSVDB_KERNEL bool areNone(Mask mask) { return __any_sync(kAllLanes, mask.on) == 0; }
ACCESSVDB_KERNEL std::uint32_t sumOfLanes(std::uint32_t count) { return __reduce_add_sync(kAllLanes, count); }
ACCESSVDB_KERNEL std::uint64_t sumOfLanes(std::uint64_t count) {
  return __reduce_add_sync(kAllLanes, static_cast<std::uint32_t>(count));  // one leaf's
}
ACCESSVDB_KERNEL std::uint32_t sumOf(Ints a) { return sumOfLanes(static_cast<std::uint32_t>(a)); }

ACCESSVDB_KERNEL Floats ofStrip(const Floats (&of)[kSlabStrips], int strip) { return strip == 0 ? of[0] : of[1]; }
/// @param strip  of the slab
ACCESSVDB_KERNEL void setStrip(Slab& slab, int strip, Rows rows) { slab |= (rows.on ? 1u : 0u) << strip; }
ACCESSVDB_KERNEL void setSlab(Bits& bits, int x, Slab slab) { bits.of_lane |= slab << (kSlabStrips * x); }
/// @param strip  of the leaf
ACCESSVDB_KERNEL void setStrip(Bits& bits, int strip, Rows rows) { setStrip(bits.of_lane, strip, rows); }
/// Strips with any bit set.
ACCESSVDB_KERNEL std::uint32_t stripsOf(const Bits& bits) { return __reduce_or_sync(kAllLanes, bits.of_lane); }

/// Which voxels of a leaf are in a region, and which strips have any.
struct Inside {
  Bits slabs;
  std::uint32_t strips = 0;
  ACCESSVDB_KERNEL void add(int x, Slab slab) { setSlab(slabs, x, slab); }
  ACCESSVDB_KERNEL void finish() { strips = stripsOf(slabs); }
  [[nodiscard]] ACCESSVDB_KERNEL Rows ofStrip(int strip) const { return {(slabs.of_lane >> strip & 1) != 0}; }
};

// Uses what is defined above.
#include "hostdev/leaf_kernels_body.h"

// A leaf in memory is 16 words of 32 voxels, like the strips.

/// @param words  [16] of a leaf
ACCESSVDB_KERNEL Bits loadBits(const std::uint32_t* words) {
  Bits bits;
#pragma unroll
  for (int n = 0; n < kStrips / 4; ++n) {
    const uint4 four = reinterpret_cast<const uint4*>(words)[n];
    const std::uint32_t each[4] = {four.x, four.y, four.z, four.w};
#pragma unroll
    for (int i = 0; i < 4; ++i) bits.of_lane |= (each[i] >> ownLane() & 1) << (4 * n + i);
  }
  return bits;
}
ACCESSVDB_KERNEL void storeBits(const Bits& bits, std::uint32_t* words) {
  std::uint32_t own = 0;
#pragma unroll
  for (unsigned strip = 0; strip < kStrips; ++strip) {
    const std::uint32_t word = __ballot_sync(kAllLanes, (bits.of_lane >> strip & 1) != 0);
    if (ownLane() == strip) own = word;
  }
  if (ownLane() < kStrips) words[ownLane()] = own;
}

}  // namespace accessvdb::kernels::warp_lanes
