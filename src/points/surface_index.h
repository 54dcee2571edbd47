// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Finds the surface point in a voxel, and the points near a position.
///
/// Points are grouped in blocks of 8x8x8 voxels (the leaves of the map), blocks in leaf groups of 8x8x8 blocks. Only
/// leaf groups are hashed, so walking a neighbourhood costs a few look-ups, no matter how large the map is.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "points/chunked_array.h"
#include "points/id_runs.h"
#include "points/place_map.h"

namespace accessvdb::internal {

using Index3 = std::array<std::int32_t, 3>;
inline constexpr std::uint32_t kNone = ~std::uint32_t{0};

/// The points of one leaf, sorted by voxel. Aligned so that each lies in only two cache lines.
struct alignas(32) PointBlock {
  Index3 leaf = {};                  ///< voxel index >> 3
  std::uint32_t leaf_group = kNone;  ///< number of its leaf group
  std::span<std::uint32_t> ids;      ///< in the order of the set bits; a run that only the index writes to
  LeafBits occupied = {};            ///< voxels with a point
};

/// A point to be inserted into the index.
struct NewVoxel {
  Index3 voxel = {};
  std::uint32_t id = kNone;
  std::uint32_t block = kNone;  ///< kNone if not yet known; out: its block
};

/// What is known of a voxel; kNone where unknown.
struct Located {
  std::uint32_t block = kNone, id = kNone;
};

class SurfaceIndex {
 public:
  /// Id of the point in a voxel, or kNone.
  [[nodiscard]] std::uint32_t find(const Index3& voxel) const;
  /// The same if the block is known.
  [[nodiscard]] std::uint32_t findIn(std::uint32_t block, const Index3& voxel) const;
  /// Like find() for each, but also returns their blocks. Handles several at a time to hide memory latency.
  void locate(std::span<const Index3> voxels, std::span<Located> found) const;
  /// The voxel must be empty. @return index of its block
  std::uint32_t insert(const Index3& voxel, std::uint32_t id);
  /// Like insert() for each, in parallel. The voxels are empty and sorted by place (placeOf).
  void insertAll(std::span<NewVoxel> points);
  /// The blocks that the last insertAll() added to, each once, in no order.
  void blocksOfLastInsert(std::vector<std::uint32_t>& blocks) const;

  [[nodiscard]] const ChunkedArray<PointBlock>& blocks() const { return blocks_; }
  /// Index into blocks(), or kNone.
  [[nodiscard]] std::uint32_t blockAt(const Index3& leaf) const;
  /// Leaf groups are numbered in order of arrival. @param leaf_group  leaf >> 3. @return its number or kNone
  [[nodiscard]] std::uint32_t leafGroupAt(const Index3& leaf_group) const { return leaf_group_of_.find(leaf_group); }
  [[nodiscard]] std::uint32_t leafGroups() const { return static_cast<std::uint32_t>(leaf_groups_.size()); }
  /// @param bit  of the leaf inside the leaf group. @return index into blocks(), or kNone
  [[nodiscard]] std::uint32_t blockIn(std::uint32_t leaf_group, std::size_t bit) const {
    return leaf_groups_[leaf_group].block[bit];
  }
  /// The leaves inside a leaf group that have a block. A cache line, where blockIn() reads one of its own for each
  /// leaf.
  [[nodiscard]] const LeafBits& leavesIn(std::uint32_t leaf_group) const { return leaf_groups_[leaf_group].present; }
  [[nodiscard]] std::uint64_t bytes() const;

  /// Calls visit(block index), or visit(block index, its leaf), for every block with leaf coordinates in [low, high],
  /// in a fixed order. Reads no block.
  template <typename Visit>
  void forEachBlock(const Index3& low, const Index3& high, const Visit& visit) const {
    for (std::int32_t cx = low[0] >> 3; cx <= high[0] >> 3; ++cx) {
      for (std::int32_t cy = low[1] >> 3; cy <= high[1] >> 3; ++cy) {
        for (std::int32_t cz = low[2] >> 3; cz <= high[2] >> 3; ++cz) {
          const std::uint32_t found = leaf_group_of_.find({cx, cy, cz});
          if (found == kNone) continue;
          visitLeafGroup(leaf_groups_[found], {cx, cy, cz}, low, high, visit);
        }
      }
    }
  }

 private:
  struct LeafGroup {
    LeafBits present = {};
    std::array<std::uint32_t, 512> block;
  };
  /// New points of one block: [begin, end) of the points inserted together.
  struct Addition {
    std::uint32_t begin, end;
    std::uint32_t leaf_group = kNone, block = kNone;
    std::uint32_t ids_before = 0;
    std::uint32_t* larger_run = nullptr;  ///< set if the block's own run is too small
  };
  void listAdditions(std::span<const NewVoxel> points);
  void findBlock(Addition& addition, std::span<const NewVoxel> points) const;
  void locateFew(std::span<const Index3> voxels, std::span<Located> found) const;
  void makeBlocks(std::span<Addition> additions, std::span<const NewVoxel> points);
  void takeRuns(std::span<Addition> additions);
  /// Safe in parallel for different blocks.
  void addTo(const Addition& addition, std::span<NewVoxel> points);

  template <typename Visit>
  static void visitLeafGroup(const LeafGroup& leaf_group, const Index3& c, const Index3& low, const Index3& high,
                             const Visit& visit) {
    const auto from = [&](int axis) { return std::max(0, low[axis] - c[axis] * 8); };
    const auto to = [&](int axis) { return std::min(7, high[axis] - c[axis] * 8); };
    const int z0 = from(2), z1 = to(2);
    const auto row_mask = static_cast<std::uint32_t>((0xffu << z0) & (0xffu >> (7 - z1)));
    for (int x = from(0); x <= to(0); ++x) {
      for (int y = from(1); y <= to(1); ++y) {
        auto row = static_cast<std::uint32_t>(leaf_group.present[static_cast<std::size_t>(x)] >> (y * 8)) & row_mask;
        for (; row != 0; row &= row - 1) {
          const int z = std::countr_zero(row);
          const std::uint32_t block = leaf_group.block[static_cast<std::size_t>(x * 64 + y * 8 + z)];
          if constexpr (std::is_invocable_v<Visit, std::uint32_t, const Index3&>) {
            visit(block, Index3{c[0] * 8 + x, c[1] * 8 + y, c[2] * 8 + z});
          } else {
            visit(block);
          }
        }
      }
    }
  }

  PlaceMap leaf_group_of_;
  ChunkedArray<LeafGroup> leaf_groups_;
  ChunkedArray<PointBlock> blocks_;
  IdRuns runs_;
  // For one insertAll(); kept, because freshly allocated memory has to be cleared by the system first.
  std::vector<Addition> additions_;
  std::vector<std::uint32_t*> outgrown_;
};

/// Bit of a voxel or block in its parent, 0 .. 511.
inline std::size_t bitInParent(const Index3& i) {
  return static_cast<std::size_t>((i[0] & 7) << 6 | (i[1] & 7) << 3 | (i[2] & 7));
}
inline Index3 parentOf(const Index3& i) { return {i[0] >> 3, i[1] >> 3, i[2] >> 3}; }
/// Square of the distance between two blocks, in voxels that lie between them.
inline std::int64_t gapSquared(const Index3& a, const Index3& b) {
  std::int64_t squared = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t blocks_between = std::abs(std::int64_t{a[axis]} - b[axis]) - 1;
    if (blocks_between > 0) squared += 64 * blocks_between * blocks_between;
  }
  return squared;
}
/// The voxel or block with this bit in its parent.
inline Index3 childOf(const Index3& parent, std::size_t bit) {
  const auto place = static_cast<std::int32_t>(bit);
  return {8 * parent[0] + (place >> 6), 8 * parent[1] + (place >> 3 & 7), 8 * parent[2] + (place & 7)};
}

/// Returns lie at most this many voxels from the map's local origin, on each axis.
inline constexpr double kFarthestVoxel = 1e6;

/// Sorts voxels by leaf, and within a leaf by bit. Voxels lie within +-2^20, leaves within +-2^17.
inline std::uint64_t placeOf(const Index3& voxel) {
  std::uint64_t place = 0;
  for (const std::int32_t x : voxel) place = place << 18 | static_cast<std::uint64_t>((x >> 3) + (1 << 17));
  return place << 9 | bitInParent(voxel);
}
inline Index3 voxelAt(std::uint64_t place) {
  const auto axis = [&](int leaf_shift, int bit_shift) {
    const auto leaf = static_cast<std::int32_t>(place >> leaf_shift & ((1u << 18) - 1)) - (1 << 17);
    return leaf * 8 + static_cast<std::int32_t>(place >> bit_shift & 7);
  };
  return {axis(45, 6), axis(27, 3), axis(9, 0)};
}

}  // namespace accessvdb::internal
