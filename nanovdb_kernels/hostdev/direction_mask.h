// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A set of approach directions.
#pragma once

#include <cstdint>
#include <type_traits>

#include "nanovdb_compat.h"

namespace accessvdb::kernels {

/// Most words of a set: D <= 256.
inline constexpr int kMaxDirectionWords = 4;
/// Most directions of a set. A *wide* set has more than a mask holds: it is searched from the beginning whenever
/// anything changed, nothing is remembered of its directions, and only their seen bits are kept
/// (hostdev/wide_search.h).
inline constexpr int kMostMaskedDirections = 64 * kMaxDirectionWords, kMostWideDirections = 4096;
ACCESSVDB_HOSTDEV inline bool isWide(int num_directions) { return num_directions > kMostMaskedDirections; }

/// Position of the lowest set bit. @param bits  not 0
ACCESSVDB_HOSTDEV inline int lowestBit(std::uint64_t bits) {
#if defined(__CUDA_ARCH__)
  return __ffsll(static_cast<long long>(bits)) - 1;
#else
  return __builtin_ctzll(bits);
#endif
}

/// Direction d is bit d % 64 of word d / 64.
struct DirectionMask {
  std::uint64_t word[kMaxDirectionWords];

  ACCESSVDB_HOSTDEV bool test(int d) const { return (word[d >> 6] >> (d & 63)) & 1u; }
  ACCESSVDB_HOSTDEV void set(int d) { word[d >> 6] |= std::uint64_t(1) << (d & 63); }
  ACCESSVDB_HOSTDEV void reset(int d) { word[d >> 6] &= ~(std::uint64_t(1) << (d & 63)); }
};
static_assert(std::is_trivially_copyable_v<DirectionMask>);

ACCESSVDB_HOSTDEV inline DirectionMask operator|(const DirectionMask& a, const DirectionMask& b) {
  DirectionMask out;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) out.word[w] = a.word[w] | b.word[w];
  return out;
}
ACCESSVDB_HOSTDEV inline DirectionMask operator&(const DirectionMask& a, const DirectionMask& b) {
  DirectionMask out;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) out.word[w] = a.word[w] & b.word[w];
  return out;
}
/// Directions of a that are not in b.
ACCESSVDB_HOSTDEV inline DirectionMask without(const DirectionMask& a, const DirectionMask& b) {
  DirectionMask out;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) out.word[w] = a.word[w] & ~b.word[w];
  return out;
}
ACCESSVDB_HOSTDEV inline bool any(const DirectionMask& a) {
  std::uint64_t all = 0;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) all |= a.word[w];
  return all != 0;
}
ACCESSVDB_HOSTDEV inline bool operator==(const DirectionMask& a, const DirectionMask& b) {
  std::uint64_t different = 0;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) different |= a.word[w] ^ b.word[w];
  return different == 0;
}

/// Directions 0 .. num_directions - 1.
ACCESSVDB_HOSTDEV inline DirectionMask allDirections(int num_directions) {
  DirectionMask mask = {};
  for (int d = 0; d < num_directions; ++d) mask.set(d);
  return mask;
}

/// Calls visit(d) for each direction of a set, the lowest first.
template <typename Visit>
ACCESSVDB_HOSTDEV inline void forEachDirection(const DirectionMask& directions, const Visit& visit) {
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    for (std::uint64_t bits = directions.word[w]; bits != 0; bits &= bits - 1) visit(64 * w + lowestBit(bits));
  }
}

}  // namespace accessvdb::kernels
