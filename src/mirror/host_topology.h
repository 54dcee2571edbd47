// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The host's own copy of what the mirrored tree looks like, so that nothing is ever read back from the arena.
///
/// The same three levels as the mirrored tree, with 32-bit indices for links: a lookup is two array reads once the root
/// tile is known, and a new node knows its parent. The bits of a leaf lie in chunks, so that they never move either.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "accessvdb/leaf_change.h"

namespace accessvdb::internal {

/// No node.
inline constexpr std::uint32_t kNoNode = ~std::uint32_t(0);

/// An internal node: 17 KiB for the lower level, 135 KiB for the upper one.
template <int kLog2Dim>
struct InternalShadow {
  static constexpr std::uint32_t kSize = 1u << (3 * kLog2Dim);
  static constexpr std::uint32_t kWords = kSize / 64;

  std::uint64_t arena_offset = 0;                                 ///< [B] of the mirrored node
  std::array<std::uint32_t, kSize> child_plus_one = {};           ///< index of the child + 1; 0 = none
  std::array<std::uint64_t, kWords> child_mask = {};              ///< bit n = entry n is a child
  std::array<std::uint64_t, (kWords + 63) / 64> dirty_mask = {};  ///< bit w = word w of child_mask is unpublished

  [[nodiscard]] std::uint32_t child(std::uint32_t n) const noexcept { return child_plus_one[n] - 1; }
  void link(std::uint32_t n, std::uint32_t child_index) noexcept {
    child_plus_one[n] = child_index + 1;
    child_mask[n >> 6] |= std::uint64_t(1) << (n & 63);
    dirty_mask[n >> 12] |= std::uint64_t(1) << ((n >> 6) & 63);
  }
  /// Whether word `word` of the mask is unpublished; forgets it.
  [[nodiscard]] bool takeDirty(std::uint32_t word) noexcept {
    const std::uint64_t bit = std::uint64_t(1) << (word & 63);
    const bool dirty = (dirty_mask[word >> 6] & bit) != 0;
    dirty_mask[word >> 6] &= ~bit;
    return dirty;
  }
};

/// Bits of a leaf in the order of the mirrored leaf, so that both go out in one write.
struct LeafShadow {
  LeafBits arm_free = {};  ///< active
  LeafBits collides = {};  ///< value

  [[nodiscard]] bool isEmpty() const noexcept {
    std::uint64_t any = 0;
    for (int w = 0; w < 8; ++w) any |= arm_free[w] | collides[w];
    return any == 0;
  }
};
static_assert(sizeof(LeafShadow) == 128);

/// Whether an empty leaf would have bits after `change`.
[[nodiscard]] inline bool bringsBits(const LeafChange& change) noexcept {
  std::uint64_t any = 0;
  for (int w = 0; w < 8; ++w) {
    any |= (change.collides_on[w] & ~change.collides_off[w]) | (change.arm_free_on[w] & ~change.arm_free_off[w]);
  }
  return any != 0;
}

/// bits = (bits | on) & ~off. @return whether any bit changed
inline bool switchBits(LeafBits& bits, const LeafBits& on, const LeafBits& off) noexcept {
  std::uint64_t changed = 0;
  for (int w = 0; w < 8; ++w) {
    const std::uint64_t after = (bits[w] | on[w]) & ~off[w];
    changed |= after ^ bits[w];
    bits[w] = after;
  }
  return changed != 0;
}

/// Leaves that lie behind each other on both sides. Slot = chunk * kSize + place in the chunk.
struct alignas(64) LeafChunk {
  static constexpr std::uint32_t kSize = 512;
  using Flags = std::array<std::uint64_t, kSize / 64>;

  std::array<LeafShadow, kSize> leaves = {};
  std::uint64_t arena_offset = 0;  ///< [B] of the first leaf
  Flags listed = {};               ///< stands in the list of leaves that may have bits
  Flags patched = {};              ///< stands in the list of leaves to rewrite in this call
};

/// Root keys to upper nodes: linear probing in a table that is never more than half full.
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
