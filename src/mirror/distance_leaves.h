// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves of the mirror of distances: value = metres, active = observed; as in the map's own "distance" grid.
#pragma once

#include <bit>
#include <cstdint>

#include "accessvdb/distance_change.h"
#include "launch/distance_patch.h"
#include "launch/leaf_patch.h"

namespace accessvdb::internal {

struct DistanceLeaves {
  using Build = float;
  using Change = DistanceChange;
  static constexpr const char* kGridName = "distance";
  static constexpr auto kGridType = nanovdb::GridType::Float;
  static constexpr auto kPatch = kernels::PatchKind::Distances;
  static constexpr std::uint32_t kBatch = 32;  ///< changes that a thread takes at a time: 64 KB of rows at most

  DistanceCode code = {};
  float background_m = 0;  ///< for what was never observed

  [[nodiscard]] static bool adds(const DistanceChange& change) noexcept { return change.row_pairs != 0; }
  /// `packed` is the leaf as it is now, so only the rows accumulate.
  static void append(DistanceChange& change, const DistanceChange& next) noexcept {
    change.row_pairs |= next.row_pairs;
    change.packed = next.packed;
    change.blocked = next.blocked;
  }

  [[nodiscard]] float background() const noexcept { return background_m; }

  // What is sent.
  [[nodiscard]] static std::uint32_t maskOf(const DistanceChange& change) noexcept { return change.row_pairs; }
  /// What copyWords() will read is scattered in memory.
  static void prefetchWords([[maybe_unused]] const DistanceChange& change) noexcept {
#if defined(__GNUC__)
    for (std::uint32_t pairs = change.row_pairs; pairs != 0; pairs &= pairs - 1) {
      __builtin_prefetch(change.packed + std::size_t{kVoxelsPerRowPair} * std::countr_zero(pairs));
    }
#endif
  }
  std::byte* copyWords(const DistanceChange& change, std::uint32_t mask, std::byte* to) const noexcept {
    for (; mask != 0; mask &= mask - 1, to += kernels::kRowPairBytes) {
      decode(change, std::countr_zero(mask), reinterpret_cast<float*>(to));
    }
    return to;
  }

  // Where the leaf is.
  /// Not the rows of the leaf itself: prefetching them as well was no faster.
  static void prefetch([[maybe_unused]] const std::byte* leaf, const DistanceChange& change) noexcept {
    prefetchWords(change);
#if defined(__GNUC__)
    __builtin_prefetch(leaf + kernels::kDistanceMaskBytes, 1);
#endif
  }
  /// @return bytes written
  std::uint64_t changeInPlace(std::byte* leaf, const DistanceChange& change) const noexcept {
    for (std::uint32_t pairs = change.row_pairs; pairs != 0; pairs &= pairs - 1) {
      float distances_m[kVoxelsPerRowPair];
      decode(change, std::countr_zero(pairs), distances_m);
      kernels::setRowPair(leaf, std::countr_zero(pairs), distances_m);
    }
    return static_cast<std::uint64_t>(std::popcount(change.row_pairs)) * (kernels::kRowPairBytes + 2);
  }

 private:
  void decode(const DistanceChange& change, int pair, float* distances_m) const noexcept {
    const std::uint32_t* packed = change.packed + std::size_t{kVoxelsPerRowPair} * static_cast<std::size_t>(pair);
    const DistanceCode by_value = code;  // for all the compiler knows, the writes could alias it
    const auto row = static_cast<std::size_t>(pair);
    const auto blocked = static_cast<std::uint32_t>(change.blocked[row >> 2] >> (kVoxelsPerRowPair * (row & 3)));
    for (std::size_t n = 0; n < kVoxelsPerRowPair; ++n) {
      const float distance_m = (blocked >> n & 1) != 0 ? 0 : by_value.distance_m(packed[n]);
      distances_m[n] = by_value.observed(packed[n]) ? distance_m : kernels::kKeepDistance;
    }
  }
};

}  // namespace accessvdb::internal
