// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a warp keeps in shared memory of the map around its point, so that a voxel takes two or three reads instead of
/// a walk from the root: the leaves within the tool's reach or, if there are too many, the nodes above them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/search/window_plan.h"
#include "hostdev/cell_counts.h"

namespace accessvdb::kernels {

/// Nodes are identified by their byte offset from the grid / 32, their alignment; the grid itself lies at 0.
inline constexpr std::uint32_t kNodeBytes = NANOVDB_DATA_ALIGNMENT;
/// Bits of a leaf: 8 bytes per x, one byte per row of eight z.
inline constexpr std::uint32_t kValueBytes = offsetof(OccupancyLeaf::DataType, mValues);
inline constexpr std::uint32_t kActiveBytes = offsetof(OccupancyLeaf::DataType, mValueMask);
inline constexpr std::uint32_t kLowerTableBytes = offsetof(OccupancyLower::DataType, mTable);
inline constexpr int kLeafLog2 = 3, kLowerLog2 = 7;

[[nodiscard]] __device__ inline const std::uint8_t* nodeAt(const std::uint8_t* grid, std::uint32_t offset) {
  return grid + static_cast<std::uint64_t>(offset) * kNodeBytes;
}
[[nodiscard]] __device__ inline std::uint32_t offsetOfNode(const std::uint8_t* grid, const void* node) {
  return static_cast<std::uint32_t>(static_cast<std::uint64_t>(static_cast<const std::uint8_t*>(node) - grid) /
                                    kNodeBytes);
}

/// Whether anything in a leaf collides, by its cell counts.
__device__ inline bool collidesSomewhere(const std::uint8_t* leaf) {
  return *reinterpret_cast<const std::uint64_t*>(leaf + kCellCountsBytes) != 0;
}

/// One of the threads that fill a window together.
struct Together {
  int rank, threads;
};

/// Address arithmetic shared by both windows. Coordinates are voxels from the window's corner, never negative. To save
/// registers the shape is not copied: it is a kernel argument or lies in shared memory.
class WindowBase {
 public:
  __device__ WindowBase(std::uint32_t* nodes, const WindowShape& shape, const OccupancyGrid* grid,
                        const Coord& point_ijk, int log2)
      : nodes_(nodes), shape_(shape), grid_(reinterpret_cast<const std::uint8_t*>(grid)) {
    for (int axis = 0; axis < 3; ++axis) origin_[axis] = ((point_ijk[axis] >> log2) + shape.begin[axis]) * (1 << log2);
    log2_ = log2;
  }
  /// Whether the window holds this voxel.
  __device__ bool holds(const Coord& ijk) const {
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      inside = inside && static_cast<std::uint32_t>(ijk[axis] - origin_[axis]) >> log2_ <
                             static_cast<std::uint32_t>(shape_.size[axis]);
    }
    return inside;
  }

  /// [voxels] of a voxel from the window's corner.
  [[nodiscard]] __device__ std::int32_t fromCorner(const Coord& ijk, int axis) const {
    return ijk[axis] - origin_[axis];
  }

 protected:
  [[nodiscard]] __device__ std::uint32_t index(int x, int y, int z) const {
    return static_cast<std::uint32_t>(((x >> log2_) * shape_.size[1] + (y >> log2_)) * shape_.size[2] + (z >> log2_));
  }
  [[nodiscard]] __device__ Coord originOf(int n) const {
    const int z = n % shape_.size[2], xy = n / shape_.size[2];
    return Coord(origin_[0] + (xy / shape_.size[1] << log2_), origin_[1] + (xy % shape_.size[1] << log2_),
                 origin_[2] + (z << log2_));
  }
  [[nodiscard]] __device__ const std::uint8_t* node(std::uint32_t offset) const { return nodeAt(grid_, offset); }
  [[nodiscard]] __device__ std::uint32_t offsetOf(const void* node) const { return offsetOfNode(grid_, node); }

  std::uint32_t* nodes_;
  const WindowShape& shape_;
  const std::uint8_t* grid_;
  std::int32_t origin_[3];  ///< [voxels] of the window's corner
  int log2_;
};

/// A window of leaves. Entry: offset of the leaf shifted left by one, bit 0 = something in it collides; 0 = no leaf.
class LeafWindow : public WindowBase {
 public:
  static constexpr int kLog2 = kLeafLog2;

  /// Some threads call it together, and synchronise before they read.
  __device__ LeafWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                        const Coord& point_ijk, Together together)
      : WindowBase(nodes, shape, map.grid, point_ijk, kLog2) {
    const nanovdb::DefaultReadAccessor<bool> accessor(map.grid->tree().root());
    const int count = static_cast<int>(shape.nodes());
    for (int n = together.rank; n < count; n += together.threads) {
      const OccupancyLeaf* leaf = accessor.probeLeaf(originOf(n));
      std::uint32_t entry = 0;
      if (leaf != nullptr) {
        const auto* words =
            reinterpret_cast<const std::uint64_t*>(reinterpret_cast<const std::uint8_t*>(leaf) + kValueBytes);
        std::uint64_t any = 0;
        for (int w = 0; w < 8; ++w) any |= words[w];
        entry = offsetOf(leaf) << 1 | (any != 0 ? 1u : 0u);
      }
      nodes[n] = entry;
    }
  }

  /// Counts the `wanted` voxels that collide in the row of eight z from z & ~7 on.
  [[nodiscard]] __device__ int countRow(int x, int y, int z, std::uint32_t wanted) const {
    // No branches: where nothing can collide, it reads a byte of the grid's header and masks out all of its bits.
    const std::uint32_t entry = nodes_[wanted != 0 ? index(x, y, z) : 0];
    const std::uint32_t some = 0u - (entry & 1u);
    return __popc(node((entry >> 1) & some)[kValueBytes + static_cast<std::uint32_t>((x & 7) * 8 + (y & 7))] & wanted &
                  some);
  }
  [[nodiscard]] __device__ const std::uint8_t* leafOf(int x, int y, int z) const {
    const std::uint32_t entry = nodes_[index(x, y, z)];
    return entry != 0 ? node(entry >> 1) : nullptr;
  }
  [[nodiscard]] __device__ bool bit(const Coord& ijk, std::uint32_t mask_bytes) const {
    const int x = ijk[0] - origin_[0], y = ijk[1] - origin_[1], z = ijk[2] - origin_[2];
    const std::uint32_t entry = nodes_[index(x, y, z)];
    if (entry == 0) return false;
    return (node(entry >> 1)[mask_bytes + static_cast<std::uint32_t>((x & 7) * 8 + (y & 7))] >> (z & 7) & 1u) != 0;
  }
};

/// A window of lower nodes: a leaf takes one more read. Any tool fits. Entry: offset of the node; 0 = none.
class LowerWindow : public WindowBase {
 public:
  static constexpr int kLog2 = kLowerLog2;

  /// The caller fills `nodes`.
  __device__ LowerWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                         const Coord& point_ijk)
      : WindowBase(nodes, shape, map.grid, point_ijk, kLog2) {}
  /// Like the constructor of LeafWindow.
  __device__ LowerWindow(std::uint32_t* nodes, const WindowShape& shape, const OccupancyView& map,
                         const Coord& point_ijk, Together together)
      : WindowBase(nodes, shape, map.grid, point_ijk, kLog2) {
    const auto& root = map.grid->tree().root();
    const int count = static_cast<int>(shape.nodes());
    for (int n = together.rank; n < count; n += together.threads) {
      const Coord ijk = originOf(n);
      const auto key = OccupancyRoot::DataType::CoordToKey(ijk);
      std::uint32_t entry = 0;
      for (std::uint32_t t = 0; t < root.tileCount(); ++t) {
        const auto* tile = root.data()->tile(t);
        if (tile->key != key || !tile->isChild()) continue;
        const OccupancyUpper* upper = root.data()->getChild(tile);
        const std::uint32_t place = OccupancyUpper::CoordToOffset(ijk);
        if (upper->data()->mChildMask.isOn(place)) entry = offsetOf(upper->data()->getChild(place));
        break;
      }
      nodes[n] = entry;
    }
  }

  [[nodiscard]] __device__ int countRow(int x, int y, int z, std::uint32_t wanted) const {
    const std::uint8_t* leaf = wanted != 0 ? leafOf(x, y, z) : nullptr;
    if (leaf == nullptr) return 0;
    return __popc(leaf[kValueBytes + static_cast<std::uint32_t>((x & 7) * 8 + (y & 7))] & wanted);
  }
  [[nodiscard]] __device__ bool bit(const Coord& ijk, std::uint32_t mask_bytes) const {
    const int x = ijk[0] - origin_[0], y = ijk[1] - origin_[1], z = ijk[2] - origin_[2];
    const std::uint8_t* leaf = leafOf(x, y, z);
    if (leaf == nullptr) return false;
    return (leaf[mask_bytes + static_cast<std::uint32_t>((x & 7) * 8 + (y & 7))] >> (z & 7) & 1u) != 0;
  }

  /// The mirror writes table entries only for children, and memory that it never wrote is zero: 0 = no leaf.
  [[nodiscard]] __device__ const std::uint8_t* leafOf(int x, int y, int z) const {
    const std::uint32_t entry = nodes_[index(x, y, z)];
    if (entry == 0) return nullptr;
    const std::uint8_t* lower = node(entry);
    const int place = (x >> kLeafLog2 & 15) << 8 | (y >> kLeafLog2 & 15) << 4 | (z >> kLeafLog2 & 15);
    const std::int64_t child = reinterpret_cast<const std::int64_t*>(lower + kLowerTableBytes)[place];
    return child == 0 ? nullptr : lower + child;
  }
};

/// Answers like OccupancyReader, for voxels inside the window.
template <class Nodes>
class WindowReader : public Nodes {
 public:
  using Nodes::Nodes;
  [[nodiscard]] __device__ bool collides(const Coord& ijk) const { return this->bit(ijk, kValueBytes); }
  [[nodiscard]] __device__ bool armFree(const Coord& ijk) const { return this->bit(ijk, kActiveBytes); }

  /// Collisions of a tool column placed at a voxel, as countVoxelCollisions counts them. Two rows per iteration, so
  /// that their reads overlap.
  [[nodiscard]] __device__ int countColumn(const VoxelColumn& column, const Coord& point_ijk) const {
    const int x = point_ijk[0] - this->origin_[0] + column.dx, y = point_ijk[1] - this->origin_[1] + column.dy;
    int z = point_ijk[2] - this->origin_[2] + column.dz;
    const int shift = z & 7;
    std::uint64_t bits = column.bits;
    std::uint32_t low = static_cast<std::uint32_t>(bits << shift) & 0xffu;
    bits >>= 8 - shift;
    int count = 0;
    while (true) {
      const std::uint32_t high = static_cast<std::uint32_t>(bits) & 0xffu;
      count += this->countRow(x, y, z, low) + this->countRow(x, y, z + 8, high);
      bits >>= 8;
      if (bits == 0) return count;
      low = static_cast<std::uint32_t>(bits) & 0xffu;
      bits >>= 8;
      z += 16;
    }
  }
};

/// The same interface, answered by walking the tree.
class TreeWindow {
 public:
  __device__ explicit TreeWindow(const OccupancyView& view) : reader_(view) {}
  [[nodiscard]] __device__ bool holds(const Coord&) const { return true; }
  [[nodiscard]] __device__ bool collides(const Coord& ijk) const { return reader_.collides(ijk); }
  [[nodiscard]] __device__ bool armFree(const Coord& ijk) const { return reader_.armFree(ijk); }
  [[nodiscard]] __device__ int countColumn(const VoxelColumn& column, const Coord& point_ijk) const {
    const std::int32_t x = point_ijk[0] + column.dx, y = point_ijk[1] + column.dy, z = point_ijk[2] + column.dz;
    const int shift = z & 7;
    std::int32_t row = z - shift;
    std::uint64_t bits = column.bits;
    std::uint32_t wanted = static_cast<std::uint32_t>(bits << shift) & 0xffu;
    bits >>= 8 - shift;
    int count = 0;
    while (true) {
      if (wanted != 0) count += __popc(reader_.collidesRow(Coord(x, y, row)) & wanted);
      if (bits == 0) return count;
      wanted = static_cast<std::uint32_t>(bits) & 0xffu;
      bits >>= 8;
      row += 8;
    }
  }

 private:
  OccupancyReader reader_;
};

/// Facts of a voxel, by a walk from the root: bit 0 = collides, bit 1 = free for the corridor.
static __device__ __noinline__ std::uint32_t factsFromRoot(const OccupancyGrid* grid, int x, int y, int z) {
  const nanovdb::DefaultReadAccessor<bool> accessor(grid->tree().root());
  bool collides = false;
  const bool is_free = accessor.probeValue(Coord(x, y, z), collides);
  return (collides ? 1u : 0u) | (is_free ? 2u : 0u);
}

/// Answers like OccupancyReader, for the few voxels that no window holds. Not inlined, and without a
/// reader's memory of where it was: a search has neither instruction cache nor registers to spare.
class MapOutside {
 public:
  explicit __device__ MapOutside(const OccupancyView& view) : grid_(view.grid) {}
  [[nodiscard]] __device__ bool collides(const Coord& ijk) const { return (facts(ijk) & 1u) != 0; }
  [[nodiscard]] __device__ bool armFree(const Coord& ijk) const { return (facts(ijk) & 2u) != 0; }

 private:
  [[nodiscard]] __device__ std::uint32_t facts(const Coord& ijk) const {
    return factsFromRoot(grid_, ijk[0], ijk[1], ijk[2]);
  }
  const OccupancyGrid* grid_;
};

}  // namespace accessvdb::kernels
