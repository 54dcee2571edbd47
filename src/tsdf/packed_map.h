// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The authored map: one OpenVDB tree of 32-bit voxels instead of three grids.
///
/// value  = mean distance in 20 bits | weight in 12 bits; 0 = unobserved
/// active = cleared; where free space ages: confirmed to be free in this generation (free_generations.h)
///
/// A leaf that rays only passed through has no buffer (OpenVDB's PartialCreate): 112 bytes instead of 2.2 kB. Of one
/// that no scan has touched for a while, the values are compact (leaf_values.h). Integration is bound by memory, so
/// this, not arithmetic, decides its speed (docs/design/map.md, "The authored map").
#pragma once

#include <cstdint>
#include <memory>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "accessvdb/params.h"
#include "accessvdb/voxel_state.h"
#include "tsdf/cold_leaves.h"
#include "tsdf/free_generations.h"
#include "tsdf/leaf_values.h"
#include "tsdf/left_out_voxels.h"
#include "tsdf/map_tree.h"
#include "tsdf/new_things.h"
#include "tsdf/vote_pool.h"

namespace accessvdb::internal {

class PackedMap {
 public:
  explicit PackedMap(const TsdfParams& resolved);
  ~PackedMap();  // not inline: what destroys a tree compiles most of its functions

  [[nodiscard]] const TsdfParams& params() const { return params_; }
  [[nodiscard]] PackedTree& tree() { return tree_; }
  [[nodiscard]] const PackedTree& tree() const { return tree_; }

  /// Metres of a stored mean; the one place where steps become metres.
  [[nodiscard]] float distanceOf(std::uint32_t mean) const { return clamp_min_m_ + static_cast<float>(mean) * step_m_; }
  /// The same for code that reads stored voxels without this class.
  [[nodiscard]] DistanceCode distanceCode() const { return {clamp_min_m_, step_m_, kWeightBits}; }
  /// A voxel with weight collides if its mean is below this: the least mean whose distance is >= r_c.
  [[nodiscard]] std::uint32_t collisionMean() const { return collision_mean_; }
  void setCollisionDistance(float r_c_m);

  /// From now on, things that appear where the map says "free" block by votes (new_things.h). After
  /// setCollisionDistance(). @param far_m  voxels at least this far from every surface are far from all of them
  void blockNewThings(float far_m);
  [[nodiscard]] bool blocksNewThings() const { return votes_ != nullptr; }
  [[nodiscard]] const NewsRule& newsRule() const { return news_; }
  /// nullptr unless blockNewThings() was called.
  [[nodiscard]] VotePool* votePool() { return votes_.get(); }
  /// The votes of a leaf; nullptr if it has none.
  [[nodiscard]] const VoxelVotes* votesOf(const PackedLeaf& leaf) const {
    const std::uint32_t number = voteNumberOf(leaf);
    return number == 0 ? nullptr : &votes_->get(number);
  }
  /// Their number in votePool(); 0 if it has none.
  [[nodiscard]] std::uint32_t voteNumberOf(const PackedLeaf& leaf) const {
    const std::uint32_t number = leaf.transientData();
    return number == 0 || generations_ == nullptr ? number : generations_->records().get(number).votes;
  }
  void setVoteNumber(PackedLeaf& leaf, std::uint32_t number);
  /// Leaves that have votes.
  [[nodiscard]] std::uint64_t votedLeafCount() const { return votes_ == nullptr ? 0 : votes_->size(); }
  /// Of all voxels of a leaf, those that votes block.
  [[nodiscard]] LeafBits blockedIn(const PackedLeaf& leaf) const {
    LeafBits blocked = {};
    if (const VoxelVotes* votes = votesOf(leaf)) {
      for (std::size_t x = 0; x < 8; ++x) blocked[x] = votes->blocked(x);
    }
    return blocked;
  }

  /// From now on, free space ages. For an empty map, after blockNewThings(). @param free_for_s  [T] > 0, finite
  void ageFreeSpace(double free_for_s);
  [[nodiscard]] bool agesFreeSpace() const { return generations_ != nullptr; }
  /// nullptr unless ageFreeSpace() was called.
  [[nodiscard]] FreeGenerations* generations() { return generations_.get(); }
  [[nodiscard]] const FreeGenerations* generations() const { return generations_.get(); }
  /// What was free in a leaf in the generation before; nullptr if nothing was, or if free space does not age.
  [[nodiscard]] const LeafBits* beforeOf(const PackedLeaf& leaf) const {
    if (generations_ == nullptr || leaf.transientData() == 0) return nullptr;
    return &generations_->records().get(leaf.transientData()).before;
  }
  void setBefore(PackedLeaf& leaf, const LeafBits& before);
  /// The same with a batch of numbers of generations()->records().
  void setBefore(PackedLeaf& leaf, const LeafBits& before, RecordPool<AgedLeaf>::Batch& records);
  /// Leaves with something free in the generation before.
  [[nodiscard]] std::uint64_t agedLeafCount() const;
  /// Voxels that rays confirmed to be free and that have not aged since; without ageing, the cleared ones.
  [[nodiscard]] LeafBits confirmedIn(const PackedLeaf& leaf) const;
  /// Whether a voxel with this mean and weight counts as free for an arm. @param n  its place in the leaf
  [[nodiscard]] bool isKnownFree(const PackedLeaf& leaf, openvdb::Index n) const {
    if (leaf.isValueOn(n)) return true;
    const LeafBits* before = beforeOf(leaf);
    return before != nullptr && ((*before)[n >> 6] >> (n & 63) & 1) != 0;
  }
  /// Of all voxels of a leaf, those that collide.
  [[nodiscard]] LeafBits collidingIn(const PackedLeaf& leaf) const;

  /// From now on no leaf is added and none gets values: where a scan would need one, it is left out and blocks. Leaves
  /// that have values go on exactly as if the map grew.
  /// @param most_left_out_leaves  so many keep their voxels
  void stopGrowing(std::size_t most_left_out_leaves) {
    grows_ = false;
    left_out_.keepMost(most_left_out_leaves);
  }
  [[nodiscard]] bool grows() const { return grows_; }
  /// Whether returns can become points in a leaf.
  [[nodiscard]] bool hasPlaceFor(const openvdb::Coord& ijk, ConstPackedAccessor& accessor) const;
  [[nodiscard]] LeftOutVoxels& leftOut() { return left_out_; }
  [[nodiscard]] const LeftOutVoxels& leftOut() const { return left_out_; }

  [[nodiscard]] VoxelState at(const openvdb::Coord& ijk) const;

  /// Puts a leaf of a saved map in place; the counts below include it. Leaves of one node are added fastest together.
  /// @param origin_ijk  multiples of 8  @param packed  [512], or nullptr for a leaf that is only cleared
  /// @param votes, before  nullptr: none
  /// @return the leaf, or nullptr if there is one or a voxel is not one that this map can have
  PackedLeaf* restoreLeaf(const openvdb::Coord& origin_ijk, const LeafBits& cleared, const std::uint32_t* packed,
                          const VoxelVotes* votes = nullptr, const LeafBits* before = nullptr);

  /// The values of a leaf, to be written: a compact one becomes plain. Of different leaves from several threads.
  /// @return nullptr if it has none  @throws std::bad_alloc
  std::uint32_t* openValues(PackedLeaf& leaf) {
    if (LeafValues(leaf).compact() != nullptr) cold_.makePlain(leaf);
    return plainValues(leaf);
  }
  /// Which leaves are compact.
  [[nodiscard]] ColdLeaves& cold() { return cold_; }
  [[nodiscard]] const ColdLeaves& cold() const { return cold_; }

  std::uint64_t leaf_count = 0;            ///< all leaves
  std::uint64_t allocated_leaf_count = 0;  ///< those with values, plain or compact
  std::uint64_t observed_voxels = 0;

  [[nodiscard]] std::uint64_t memoryBytes() const;

 private:
  TsdfParams params_;
  PackedTree tree_;
  float clamp_min_m_, step_m_;
  std::uint32_t collision_mean_ = 0;
  NewsRule news_;
  std::unique_ptr<VotePool> votes_;
  std::unique_ptr<FreeGenerations> generations_;
  bool grows_ = true;
  LeftOutVoxels left_out_;
  ColdLeaves cold_;

  [[nodiscard]] std::uint32_t leastMeanAt(float distance_m) const;
};

inline bool PackedMap::hasPlaceFor(const openvdb::Coord& ijk, ConstPackedAccessor& accessor) const {
  if (grows_) return true;
  const auto* node = accessor.probeConstNode<PackedLowerNode>(ijk);
  if (node == nullptr) return false;
  const openvdb::Index n = PackedLowerNode::coordToOffset(ijk);
  return node->isChildMaskOn(n) && !node->getTable()[n].getChild()->buffer().empty();
}

/// Bytes that a leaf costs, including malloc's word for the node (buffers come from the pool); asserted in a test.
inline constexpr std::uint64_t kClearedLeafBytes = (sizeof(PackedLeaf) + sizeof(void*) + 15) / 16 * 16;
inline constexpr std::uint64_t kObservedLeafBytes = kClearedLeafBytes + PackedLeaf::SIZE * sizeof(PackedVoxel);

}  // namespace accessvdb::internal
