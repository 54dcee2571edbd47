// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The host's own copy of the mirrored tree's topology, so that nothing is ever read back from the arena.
///
/// The same three levels as the mirrored tree, with 32-bit indices for links: a lookup is two array reads once the root
/// tile is known, and a new node knows its parent. The leaves themselves are not copied.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "launch/grid_growth.h"

namespace accessvdb::internal {

/// No node.
inline constexpr std::uint32_t kNoNode = ~std::uint32_t(0);

/// An internal node: 17 KiB for the lower level, 135 KiB for the upper one.
template <int kLog2Dim>
struct InternalShadow {
  static constexpr std::uint32_t kSize = 1u << (3 * kLog2Dim);
  static constexpr std::uint32_t kWords = kSize / 64;

  std::uint64_t arena_offset = 0;                                 ///< [B] offset of the mirrored node
  std::array<std::int32_t, 3> origin_ijk = {};                    ///< lowest voxel
  std::array<std::uint32_t, kSize> child_plus_one = {};           ///< index of the child + 1; 0 = none
  std::array<std::uint64_t, kWords> child_mask = {};              ///< bit n = the mirrored entry n is a child
  std::array<std::uint64_t, (kWords + 63) / 64> dirty_mask = {};  ///< bit w = word w of child_mask is unpublished

  [[nodiscard]] std::uint32_t child(std::uint32_t n) const noexcept { return child_plus_one[n] - 1; }

  // Several threads may call the functions below, with different n.

  /// @return false: there already is a child
  [[nodiscard]] bool link(std::uint32_t n, std::uint32_t child_index) noexcept {
    std::uint32_t none = 0;
    return std::atomic_ref(child_plus_one[n]).compare_exchange_strong(none, child_index + 1, std::memory_order_relaxed);
  }
  void unlink(std::uint32_t n) noexcept { child_plus_one[n] = 0; }
  /// Adds a child to the mask that the mirrored node already has.
  void markPublished(std::uint32_t n) noexcept {
    std::atomic_ref(child_mask[n >> 6]).fetch_or(std::uint64_t(1) << (n & 63), std::memory_order_relaxed);
  }
  /// Adds a child to the mask. @return whether the caller has to publish the word
  [[nodiscard]] bool mark(std::uint32_t n) noexcept {
    markPublished(n);
    const std::uint64_t bit = std::uint64_t(1) << ((n >> 6) & 63);
    return (std::atomic_ref(dirty_mask[n >> 12]).fetch_or(bit, std::memory_order_relaxed) & bit) == 0;
  }
  void forgetDirty(std::uint32_t n) noexcept {
    const std::uint64_t bit = std::uint64_t(1) << ((n >> 6) & 63);
    std::atomic_ref(dirty_mask[n >> 12]).fetch_and(~bit, std::memory_order_relaxed);
  }
};

/// Leaves that are contiguous in the arena. Slot = chunk * kSize + place in the chunk.
struct LeafChunk {
  static constexpr std::uint32_t kSize = kernels::kLeavesPerChunk;

  /// For each leaf, the number of the last call that changed it.
  std::array<std::uint32_t, kSize> call = {};

  /// @return false if the leaf already occurred in this call; may be called by several threads at once
  [[nodiscard]] bool comesFirst(std::uint32_t slot, std::uint32_t number) noexcept {
    return std::atomic_ref(call[slot % kSize]).exchange(number, std::memory_order_relaxed) != number;
  }
};

/// Maps root keys to upper nodes: linear probing in a table that is never more than half full.
class RootTable {
 public:
  explicit RootTable(std::uint32_t capacity) {
    std::size_t size = 16;
    while (size < 2 * std::size_t(capacity)) size *= 2;
    entries_.resize(size);
  }
  [[nodiscard]] std::uint32_t find(std::uint64_t key) const noexcept {
    return entries_[slotOf(key)].index_plus_one - 1;
  }
  void insert(std::uint64_t key, std::uint32_t index) noexcept { entries_[slotOf(key)] = {key, index + 1}; }
  [[nodiscard]] std::uint64_t bytes() const noexcept { return entries_.size() * sizeof(Entry); }

 private:
  struct Entry {
    std::uint64_t key = 0;
    std::uint32_t index_plus_one = 0;
  };
  /// The entry of `key`, or the free one where it belongs.
  [[nodiscard]] std::size_t slotOf(std::uint64_t key) const noexcept {
    std::uint64_t hash = key * 0x9E3779B97F4A7C15u;
    hash ^= hash >> 32;
    std::size_t slot = hash & (entries_.size() - 1);
    while (entries_[slot].index_plus_one != 0 && entries_[slot].key != key) slot = (slot + 1) & (entries_.size() - 1);
    return slot;
  }
  std::vector<Entry> entries_;
};

}  // namespace accessvdb::internal
