// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are around a voxel, laid out for millions of look-ups per second: the same grouping as SurfaceIndex
/// (blocks of 8^3 voxels, leaf groups of 8^3 blocks), but with leaf groups in a flat hash table and positions inside
/// the blocks, because reading them anywhere else costs a cache miss each.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <memory>
#include <vector>

#include "hostdev/place_key.h"
#include "points/point_store.h"

namespace accessvdb::internal {

class QueryIndex {
 public:
  struct Entry {
    float position_L[3];  ///< first return
    std::uint32_t id;
  };
  /// The points of one leaf; entries in the order of the set bits.
  struct alignas(64) Block {
    LeafBits occupied = {};
    std::array<std::uint16_t, 8> below = {};  ///< number of points in the words of `occupied` before each
    std::vector<Entry> entries;
    Index3 leaf = {};

    [[nodiscard]] bool has(std::size_t bit) const { return (occupied[bit >> 6] >> (bit & 63) & 1u) != 0; }
    [[nodiscard]] const Entry& at(std::size_t bit) const {
      const std::uint64_t lower = (std::uint64_t{1} << (bit & 63)) - 1;
      return entries[below[bit >> 6] + std::size_t(std::popcount(occupied[bit >> 6] & lower))];
    }
  };
  /// Which blocks of the leaf group hold points, and their indices into blocks().
  struct alignas(64) LeafGroup {
    LeafBits present = {};
    std::uint32_t block[512] = {};

    [[nodiscard]] bool has(std::size_t bit) const { return (present[bit >> 6] >> (bit & 63) & 1u) != 0; }
  };

  /// Adds the points new since the last call. @param points  the same store each time; it only grows
  void extend(const PointStore& points);

  [[nodiscard]] const std::vector<Block>& blocks() const { return blocks_; }

  /// The leaf group (8^3 blocks) with these coordinates, or nullptr.
  [[nodiscard]] const LeafGroup* leafGroupAt(const Index3& leaf_group) const {
    if (slots_.empty()) return nullptr;
    const std::uint64_t key = kernels::placeKey(leaf_group[0], leaf_group[1], leaf_group[2]);
    for (std::size_t n = slotOf(key);; n = (n + 1) & (slots_.size() - 1)) {
      if (slots_[n].leaf_group == nullptr || slots_[n].key == key) return slots_[n].leaf_group;
    }
  }
  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Slot {
    std::uint64_t key = 0;
    LeafGroup* leaf_group = nullptr;
  };
  [[nodiscard]] std::size_t slotOf(std::uint64_t key) const {
    key *= 0x9E3779B97F4A7C15u;
    return (key ^ key >> 32) & (slots_.size() - 1);
  }
  LeafGroup& leafGroupFor(const Index3& leaf_group);
  void place(const Slot& slot);

  std::vector<std::unique_ptr<LeafGroup>> leaf_groups_;
  std::vector<Slot> slots_;  ///< linear probing, at most half full
  std::vector<Block> blocks_;
};

}  // namespace accessvdb::internal
