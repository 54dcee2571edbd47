// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves of the mirror that scoring reads: value bit = collides, active bit = arm_free.
#pragma once

#include <cstdint>
#include <cstring>

#include "accessvdb/leaf_change.h"
#include "launch/leaf_patch.h"

namespace accessvdb::internal {

struct OccupancyLeaves {
  using Build = bool;
  using Change = LeafChange;
  static constexpr const char* kGridName = "occupancy";
  static constexpr auto kGridType = nanovdb::GridType::Boolean;
  static constexpr auto kPatch = kernels::PatchKind::Bits;
  static constexpr std::uint32_t kBatch = 256;  ///< changes that a thread takes at a time

  /// Whether an empty leaf would have bits after `change`.
  [[nodiscard]] static bool adds(const LeafChange& change) noexcept {
    std::uint64_t any = 0;
    for (std::size_t w = 0; w < 8; ++w) {
      any |= (change.collides_on[w] & ~change.collides_off[w]) | (change.arm_free_on[w] & ~change.arm_free_off[w]);
    }
    return any != 0;
  }
  /// Combines `change` followed by `next`: (b | on) & ~off after (b | on') & ~off' is again such a change.
  static void append(LeafChange& change, const LeafChange& next) noexcept {
    const auto join = [](LeafBits& on, LeafBits& off, const LeafBits& next_on, const LeafBits& next_off) {
      for (std::size_t n = 0; n < on.size(); ++n) {
        on[n] |= next_on[n];
        off[n] = next_off[n] | (off[n] & ~next_on[n]);
      }
    };
    join(change.collides_on, change.collides_off, next.collides_on, next.collides_off);
    join(change.arm_free_on, change.arm_free_off, next.arm_free_on, next.arm_free_off);
  }

  [[nodiscard]] static bool background() noexcept { return false; }

  // What is sent.
  [[nodiscard]] static std::uint32_t maskOf(const LeafChange& change) noexcept { return kernels::maskOf(change); }
  static void prefetchWords(const LeafChange& /*change*/) noexcept {}  // the words are the change itself
  static std::byte* copyWords(const LeafChange& change, std::uint32_t mask, std::byte* to) noexcept {
    return reinterpret_cast<std::byte*>(kernels::copyWords(change, mask, reinterpret_cast<std::uint64_t*>(to)));
  }

  // Where the leaf is.
  static void prefetch([[maybe_unused]] const std::byte* leaf, const LeafChange& /*change*/) noexcept {
#if defined(__GNUC__)
    for (std::size_t line = 0; line < 3; ++line) __builtin_prefetch(leaf + kernels::kLeafBitsBytes + 64 * line, 1);
#endif
  }
  /// @return bytes that changed
  static std::uint64_t changeInPlace(std::byte* leaf, const LeafChange& change) noexcept {
    auto* bits = reinterpret_cast<std::uint64_t*>(leaf + kernels::kLeafBitsBytes);
    return kernels::switchBits(bits, change) * sizeof(std::uint64_t);
  }
};

}  // namespace accessvdb::internal
