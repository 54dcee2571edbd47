// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where nodes go that are added to a mirrored grid: the rule by which a device adds them by itself, and by which the
/// host finds them afterwards (docs/design/mirror.md, "Nodes that a device adds").
///
/// From the first unused byte on: the new upper nodes, the new lower nodes, and as many new chunks of 512 leaves as are
/// needed. Leaves continue at the next slot: first in the room of the last chunk, then in the new ones.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Leaves that are contiguous in the arena.
inline constexpr std::uint32_t kLeavesPerChunk = 512;
/// Of grids of bool and of float alike.
inline constexpr std::uint64_t kUpperBytes = sizeof(OccupancyUpper::DataType);
inline constexpr std::uint64_t kLowerBytes = sizeof(OccupancyLower::DataType);

/// What a writer has to know before it adds nodes to a grid.
struct GridSpace {
  std::uint64_t top_bytes = 0;                       ///< first unused byte of the arena; all from there on are zero
  std::uint64_t last_chunk_offset = 0;               ///< [B] of the chunk of leaf slot leaves - 1; 0: no leaf yet
  std::uint32_t uppers = 0, lowers = 0, leaves = 0;  ///< nodes so far, and so the number of the next one
  std::uint32_t root_capacity = 0;                   ///< most uppers
  std::uint32_t leaf_bytes = sizeof(OccupancyLeaf::DataType);

  bool operator==(const GridSpace&) const = default;
};

/// How many nodes are added.
struct GrowthCounts {
  std::uint32_t uppers = 0, lowers = 0, leaves = 0;
};

/// Nodes that were added, by their lowest voxels, in the order of their numbers.
struct GridGrowth {
  using Origin = std::array<std::int32_t, 3>;
  std::span<const Origin> uppers, lowers, leaves;

  [[nodiscard]] GrowthCounts counts() const {
    return {static_cast<std::uint32_t>(uppers.size()), static_cast<std::uint32_t>(lowers.size()),
            static_cast<std::uint32_t>(leaves.size())};
  }
};

ACCESSVDB_HOSTDEV constexpr std::uint64_t chunkBytes(const GridSpace& space) {
  return std::uint64_t{kLeavesPerChunk} * space.leaf_bytes;
}

/// The first slot for which there is no chunk yet.
ACCESSVDB_HOSTDEV constexpr std::uint64_t firstSlotWithoutChunk(const GridSpace& space) {
  return (std::uint64_t{space.leaves} + kLeavesPerChunk - 1) / kLeavesPerChunk * kLeavesPerChunk;
}

/// Chunks that `leaves` more leaves need beside those that there are.
ACCESSVDB_HOSTDEV constexpr std::uint32_t newChunks(const GridSpace& space, std::uint32_t leaves) {
  const std::uint64_t end = std::uint64_t{space.leaves} + leaves, first = firstSlotWithoutChunk(space);
  return end <= first ? 0 : static_cast<std::uint32_t>((end - first + kLeavesPerChunk - 1) / kLeavesPerChunk);
}

/// [B] offset of the n-th new upper node.
ACCESSVDB_HOSTDEV constexpr std::uint64_t newUpperOffset(const GridSpace& space, std::uint32_t n) {
  return space.top_bytes + n * kUpperBytes;
}

/// [B] offset of the n-th new lower node.
ACCESSVDB_HOSTDEV constexpr std::uint64_t newLowerOffset(const GridSpace& space, const GrowthCounts& added,
                                                         std::uint32_t n) {
  return newUpperOffset(space, added.uppers) + n * kLowerBytes;
}

/// [B] offset of the n-th new chunk.
ACCESSVDB_HOSTDEV constexpr std::uint64_t newChunkOffset(const GridSpace& space, const GrowthCounts& added,
                                                         std::uint32_t n) {
  return newLowerOffset(space, added, added.lowers) + n * chunkBytes(space);
}

/// [B] offset of a new leaf. @param slot  at least space.leaves
ACCESSVDB_HOSTDEV constexpr std::uint64_t newLeafOffset(const GridSpace& space, const GrowthCounts& added,
                                                        std::uint32_t slot) {
  const std::uint64_t first = firstSlotWithoutChunk(space);
  if (slot < first) return space.last_chunk_offset + std::uint64_t{slot % kLeavesPerChunk} * space.leaf_bytes;
  return newChunkOffset(space, added, 0) + (slot - first) * space.leaf_bytes;
}

/// [B] from the first unused byte on; fewer nodes of any kind never take more.
ACCESSVDB_HOSTDEV constexpr std::uint64_t growthBytes(const GridSpace& space, const GrowthCounts& added) {
  return newChunkOffset(space, added, newChunks(space, added.leaves)) - space.top_bytes;
}

/// The space after a growth, for a writer that goes on before the host has followed.
ACCESSVDB_HOSTDEV constexpr GridSpace grown(const GridSpace& space, const GrowthCounts& added) {
  const std::uint32_t chunks = newChunks(space, added.leaves);
  GridSpace after = space;
  after.top_bytes += growthBytes(space, added);
  if (chunks > 0) after.last_chunk_offset = newChunkOffset(space, added, chunks - 1);
  after.uppers += added.uppers;
  after.lowers += added.lowers;
  after.leaves += added.leaves;
  return after;
}

}  // namespace accessvdb::kernels
