// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Nodes of the mirrored grid, and keys of its leaves.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/fusion/fusion_views.h"
#include "cuda/fusion/leaf_slots.h"
#include "launch/leaf_patch.h"

namespace accessvdb::kernels {

namespace grid_nodes {

using Root = OccupancyRoot::DataType;
using Upper = OccupancyUpper::DataType;
using Lower = OccupancyLower::DataType;
using Leaf = OccupancyLeaf::DataType;
using Ijk = nanovdb::Coord;

inline constexpr std::size_t kTreeBytes = sizeof(OccupancyGrid::DataType);
inline constexpr std::size_t kRootBytes = kTreeBytes + sizeof(nanovdb::NanoTree<bool>::DataType);

__device__ inline Root* rootOf(std::byte* grid) { return reinterpret_cast<Root*>(grid + kRootBytes); }
__device__ inline Root::Tile* tilesOf(Root* root) { return reinterpret_cast<Root::Tile*>(root + 1); }

/// nullptr if there is none, as below.
__device__ inline Upper* upperAt(std::byte* grid, const Ijk& ijk) {
  Root* const root = rootOf(grid);
  const auto key = Root::CoordToKey(ijk);
  const Root::Tile* const tiles = tilesOf(root);
  for (std::uint32_t n = 0; n < root->mTableSize; ++n) {
    if (tiles[n].key == key) return reinterpret_cast<Upper*>(reinterpret_cast<std::byte*>(root) + tiles[n].child);
  }
  return nullptr;
}
__device__ inline Lower* lowerIn(Upper* upper, const Ijk& ijk) {
  const std::uint32_t n = OccupancyUpper::CoordToOffset(ijk);
  if (upper == nullptr || !upper->mChildMask.isOn(n)) return nullptr;
  return reinterpret_cast<Lower*>(reinterpret_cast<std::byte*>(upper) + upper->mTable[n].child);
}
__device__ inline Leaf* leafIn(Lower* lower, const Ijk& ijk) {
  const std::uint32_t n = OccupancyLower::CoordToOffset(ijk);
  if (lower == nullptr || !lower->mChildMask.isOn(n)) return nullptr;
  return reinterpret_cast<Leaf*>(reinterpret_cast<std::byte*>(lower) + lower->mTable[n].child);
}
__device__ inline Leaf* leafAt(std::byte* grid, const Ijk& ijk) {
  return leafIn(lowerIn(upperAt(grid, ijk), ijk), ijk);
}

/// Links a child to its parent; several threads may, with different children. @param n  entry of the parent
template <class Parent>
__device__ inline void link(Parent* parent, std::uint32_t n, const void* child) {
  parent->mTable[n].child = static_cast<const std::byte*>(child) - reinterpret_cast<const std::byte*>(parent);
  auto* words = reinterpret_cast<unsigned long long*>(&parent->mChildMask);
  atomicOr(words + n / 64, 1ull << n % 64);
}

__device__ inline std::uint32_t unitOf(const std::byte* grid, const Leaf* leaf) {
  return static_cast<std::uint32_t>((reinterpret_cast<const std::byte*>(leaf) - grid) / LeafPatch::kUnit);
}
__device__ inline std::byte* leafAtUnit(std::byte* grid, std::uint32_t unit) {
  return grid + std::uint64_t{unit} * LeafPatch::kUnit;
}
__device__ inline LeafSlots& slotsOf(std::byte* leaf) { return *reinterpret_cast<LeafSlots*>(leaf + kLeafSlotsBytes); }

}  // namespace grid_nodes

/// @param leaf  [3] ijk >> 3
__device__ inline std::uint64_t leafKeyOf(const LeafKeys& space, const std::int32_t* leaf) {
  std::uint64_t upper = 0;
  std::uint32_t lower = 0, place = 0;
  for (int axis = 0; axis < 3; ++axis) {
    upper = upper * space.size[axis] + static_cast<std::uint32_t>((leaf[axis] >> 9) - space.low[axis]);
    lower = lower << 5 | (static_cast<std::uint32_t>(leaf[axis]) >> 4 & 31);
    place = place << 4 | (static_cast<std::uint32_t>(leaf[axis]) & 15);
  }
  return upper << LeafKeys::kUpperShift | std::uint64_t{lower} << LeafKeys::kLowerShift | place;
}
/// @return lowest voxel of a leaf
__device__ inline nanovdb::Coord originOf(const LeafKeys& space, std::uint64_t key) {
  const auto upper = static_cast<std::uint32_t>(key >> LeafKeys::kUpperShift);
  const std::uint32_t of_axis[3] = {upper / space.size[2] / space.size[1], upper / space.size[2] % space.size[1],
                                    upper % space.size[2]};
  nanovdb::Coord ijk;
  for (int axis = 0; axis < 3; ++axis) {
    const auto lower = static_cast<std::int32_t>(key >> (LeafKeys::kLowerShift + 10 - 5 * axis) & 31);
    const auto place = static_cast<std::int32_t>(key >> (8 - 4 * axis) & 15);
    ijk[axis] = (space.low[axis] + static_cast<std::int32_t>(of_axis[axis])) * 4096 + lower * 128 + place * 8;
  }
  return ijk;
}

/// The n-th slot that a scan takes.
__device__ inline std::uint32_t nthSlot(const SlotsView& slots, std::uint32_t n) {
  return n < slots.free_count ? slots.free[slots.free_count - 1 - n] : slots.next + (n - slots.free_count);
}

inline constexpr unsigned kFusionThreads = 256;
inline unsigned fusionBlocks(std::uint64_t threads) {
  return static_cast<unsigned>((threads + kFusionThreads - 1) / kFusionThreads);
}

}  // namespace accessvdb::kernels
