// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where every leaf of the mirror is, and where the leaves that a call adds will go.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "hostdev/nanovdb_compat.h"
#include "launch/grid_growth.h"
#include "launch/mirror_arena.h"
#include "mirror/change_batches.h"
#include "mirror/host_topology.h"
#include "mirror/node_pool.h"

namespace accessvdb::internal {

/// A node that was added and is not published yet: entry `entry` of its parent; an upper node's entry is its root tile.
struct AddedNode {
  std::uint32_t parent = kNoNode, entry = 0;
};

/// The nodes of the mirrored tree by index, and the changes of one call by leaf. Compiled for the leaf kinds of
/// occupancy_leaves.h and distance_leaves.h.
template <class Leaves>
class MirrorTopology {
 public:
  using Change = typename Leaves::Change;
  using ChangeBatch = internal::ChangeBatch<Leaves>;
  using ChangeLists = internal::ChangeLists<Leaves>;
  using Lower = InternalShadow<4>;
  using Upper = InternalShadow<5>;
  static constexpr std::uint64_t kLeafBytes = sizeof(typename nanovdb::NanoLeaf<typename Leaves::Build>::DataType);

  /// @param root_capacity  maximum number of root tiles
  /// @param used_bytes     bytes of the arena before the first node
  MirrorTopology(kernels::MirrorArena& arena, std::uint32_t root_capacity, std::uint64_t used_bytes);

  /// Finds or adds the leaf of every change; publishes nothing. If it throws, no leaf was added; nodes above that were
  /// added stay in the lists of added ones.
  /// @throw ResourceLimit  `map.root_tiles`, or the arena cannot grow
  /// @throw InternalError  an origin that is not a multiple of 8
  void locate(ChangeLists lists);

  /// The changes of the last locate(): as given, or merged if leaves occurred more than once.
  [[nodiscard]] const std::vector<ChangeBatch>& batches() const noexcept { return batches_; }
  [[nodiscard]] std::uint32_t changeCount() const noexcept { return change_count_; }
  /// Leaf of the n-th change, or kNoNode if it has none and needs none.
  [[nodiscard]] std::uint32_t slot(std::uint32_t n) const noexcept { return slots_[n]; }
  /// [B] offset in the arena.
  [[nodiscard]] std::uint64_t leafOffset(std::uint32_t slot) const noexcept {
    return chunk_offsets_[slot / LeafChunk::kSize] + std::uint64_t{slot % LeafChunk::kSize} * kLeafBytes;
  }

  /// Nodes not published yet. Added leaf n has slot firstAddedLeaf() + n; the other nodes have the last indices.
  [[nodiscard]] const std::vector<AddedNode>& addedLeaves() const noexcept { return added_leaves_; }
  [[nodiscard]] const std::vector<AddedNode>& addedLowers() const noexcept { return added_lowers_; }
  [[nodiscard]] const std::vector<AddedNode>& addedUppers() const noexcept { return added_uppers_; }
  [[nodiscard]] std::uint32_t firstAddedLeaf() const noexcept {
    return leaf_count_ - static_cast<std::uint32_t>(added_leaves_.size());
  }
  /// Room made for future leaves: [B] offset of the first of LeafChunk::kSize each.
  [[nodiscard]] std::span<const std::uint64_t> addedChunks() const noexcept {
    return {chunk_offsets_.data() + published_chunks_, chunks_.size() - published_chunks_};
  }
  void forgetAdded() noexcept;

  [[nodiscard]] kernels::GridSpace space() const noexcept;
  /// Takes over as published what a device has added and written itself (launch/grid_growth.h). After an error, part of
  /// it was taken over.
  /// @param grid_bytes  size of the grid as stored in the grid
  /// @throw InternalError  `mirror.adopted`: it contradicts what there is, or something is not published yet
  void adopt(const kernels::GridGrowth& growth, std::uint64_t grid_bytes);

  [[nodiscard]] Lower& lower(std::uint32_t index) noexcept { return lowers_[index]; }
  [[nodiscard]] Upper& upper(std::uint32_t index) noexcept { return *uppers_[index]; }
  [[nodiscard]] std::uint32_t leafCount() const noexcept { return leaf_count_; }
  [[nodiscard]] std::uint32_t lowerCount() const noexcept { return lowers_.size(); }
  [[nodiscard]] std::uint32_t upperCount() const noexcept { return static_cast<std::uint32_t>(uppers_.size()); }
  [[nodiscard]] std::uint64_t usedBytes() const noexcept { return top_; }  ///< in the arena
  [[nodiscard]] std::uint64_t hostBytes() const noexcept;

 private:
  [[nodiscard]] bool locateOnce();
  void locateBatch(ChangeBatch& batch) noexcept;
  void claimLeaves(ChangeBatch& batch) noexcept;
  [[nodiscard]] bool missesNothing(const ChangeBatch& batch) const noexcept;
  void addLowersOf(const ChangeBatch& batch);
  void reserveLeaves(std::uint32_t count);
  void addChunks(std::uint32_t count, std::uint64_t offset);
  void adoptUppers(const kernels::GridGrowth& growth, const kernels::GridSpace& before);
  void adoptLowers(const kernels::GridGrowth& growth, const kernels::GridSpace& before);
  void adoptLeaves(const kernels::GridGrowth& growth, const kernels::GridSpace& before);
  std::uint64_t allocate(std::uint64_t bytes);
  std::uint32_t addUpper(const nanovdb::Coord& ijk, std::uint64_t key);
  std::uint32_t addLower(const nanovdb::Coord& ijk);
  [[nodiscard]] std::uint32_t findLower(const nanovdb::Coord& ijk) const noexcept;
  template <class Act>
  void forEachBatch(const Act& act);

  kernels::MirrorArena& arena_;
  std::uint32_t root_capacity_;
  std::uint64_t top_;  ///< [B] of the arena in use
  std::uint32_t leaf_count_ = 0;
  std::uint32_t call_ = 0;  ///< number of the running locateOnce()

  RootTable root_table_;
  std::vector<std::unique_ptr<Upper>> uppers_;
  NodePool<Lower> lowers_;
  NodePool<LeafChunk> chunks_;
  std::vector<std::uint64_t> chunk_offsets_;  ///< [B] offset of the first leaf of each chunk
  std::size_t published_chunks_ = 0;

  // State of the last call.
  std::vector<ChangeBatch> batches_;
  std::uint32_t change_count_ = 0;
  std::vector<std::uint32_t> slots_;
  std::vector<std::uint64_t> places_;  ///< place of the change's leaf: lower node << 12 | entry
  std::vector<Change> merged_;
  std::vector<AddedNode> added_uppers_, added_lowers_, added_leaves_;
};

}  // namespace accessvdb::internal
