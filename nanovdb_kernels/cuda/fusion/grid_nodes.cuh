// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Nodes of the mirrored grid.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cuda/fusion/fusion_views.h"
#include "cuda/fusion/leaf_slots.h"
#include "hostdev/leaf_keys.h"
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

/// The n-th slot that a scan takes.
__device__ inline std::uint32_t nthSlot(const SlotsView& slots, std::uint32_t n) {
  return n < slots.free_count ? slots.free[slots.free_count - 1 - n] : slots.next + (n - slots.free_count);
}

inline constexpr unsigned kFusionThreads = 256;
inline unsigned fusionBlocks(std::uint64_t threads) {
  return static_cast<unsigned>((threads + kFusionThreads - 1) / kFusionThreads);
}

}  // namespace accessvdb::kernels
