// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fuses the leaves of one bucket into the map, and links the new ones.
///
/// Memory access is the cost: a scan reaches several hundred thousand scattered leaves. So a leaf passes several
/// stages, with those of a few other leaves in between: each stage's data is prefetched in the one before it.
///   1. its entry in the table of the node above it is prefetched;
///   2. the entry is read, and the leaf prefetched;
///   3. its returns are summed, and the values under the sums prefetched;
///   4. the sums are folded.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "tsdf/leaf_fusion.h"
#include "tsdf/packed_map.h"
#include "tsdf/return_bins.h"

namespace accessvdb::internal {

/// What the fusion of one bucket did.
struct BucketResult {
  FoldCounts counts;
  std::uint64_t flips_hash = 0;  ///< IntegrationResult::flips_hash
  std::uint64_t touched = 0, allocated = 0, new_leaves = 0;
  /// With their leaves, but not yet in the tree: linking changes nodes that other buckets read.
  std::vector<std::unique_ptr<PackedLowerNode>> new_nodes;
  /// Leaves in which what is left out has changed, with all their voxels that are left out from now on.
  std::vector<std::pair<openvdb::Coord, LeafBits>> left_out;
};

/// The leaves of one bucket with flipped facts and, if requested, those with changed distances.
struct BucketChanges {
  std::vector<LeafChange> facts;
  std::vector<DistanceChange> distances;
  bool wants_distances = false;
  bool wants_hash = false;                       ///< of `facts`
  std::function<void(const LeafChange&)> visit;  ///< null: unused; sees each of `facts` while it is in the cache
};

/// Adds nodes to the tree; not while a bucket is being fused. @throws std::bad_alloc
void linkNodes(PackedTree& tree, std::vector<std::unique_ptr<PackedLowerNode>>& nodes);

/// One per thread: its sums are kept.
class BucketFusion {
 public:
  BucketFusion(PackedMap& map, const RegionShape& shape);

  /// Different buckets may be fused at the same time: a node's leaves are all in one.
  /// @param changes  each leaf once; cleared at the beginning
  /// @param leaves  held while a leaf is added to a node of the tree, or gets another buffer though the scan does not
  /// reach it
  /// @throws std::bad_alloc; then each of the bucket's leaves is unchanged or contains the scan
  void fuse(const ReturnBins& bins, std::size_t bucket, const ReturnRay* rays, BucketChanges& changes,
            BucketResult& result, std::mutex& leaves);

 private:
  /// How many leaves ahead of its use data is asked for. Waiting leaves' sums stay in the first-level cache; 8 was as
  /// fast as 4.
  static constexpr std::size_t kEntryAhead = 16, kLeafAhead = 8, kRecordAhead = 4, kWaiting = 4;

  /// A leaf whose sums are waiting to be folded.
  struct Waiting {
    PackedLeaf* leaf = nullptr;  ///< nullptr: it is new
    std::uint32_t in_bucket = 0;
  };
  using Entry = PackedLowerNode::UnionType;

  void locateNodes();
  void askForEntry(std::size_t in_bucket) const;
  [[nodiscard]] PackedLeaf* leafOf(std::size_t in_bucket) const;
  void askForRecord(const PackedLeaf* leaf) const;
  PackedLeaf* addLeaf(std::size_t in_bucket, BucketResult& result);
  void fold(LeafFusion& fusion, const Waiting& waiting, BucketChanges& changes, BucketResult& result);
  bool foldInto(PackedLeaf& leaf, LeafFusion& fusion, const Waiting& waiting, LeafChange& change,
                BucketChanges& changes, BucketResult& result);
  void openValues(PackedLeaf& leaf, const Waiting& waiting, BucketResult& result);
  [[nodiscard]] ColdLeaves::Node& coldNodeOf(std::uint32_t number);
  bool foldBesideLeftOut(LeafFusion& fusion, const Waiting& waiting, LeafChange& change, BucketChanges& changes,
                         BucketResult& result);
  VoxelVotes* votesFor(const LeafFusion& fusion, const PackedLeaf& leaf);
  void keepVotes(PackedLeaf& leaf, const VoxelVotes* votes);

  PackedMap& map_;
  std::size_t bucket_ = 0;  ///< of fuse(), like the next one
  std::mutex* leaves_mutex_ = nullptr;
  BucketLeaves bucket_leaves_;
  std::vector<PackedLowerNode*> nodes_;        ///< [bucket_leaves_.nodes] nullptr if the tree has none yet
  std::vector<ColdLeaves::Node*> cold_nodes_;  ///< [bucket_leaves_.nodes] nullptr: not asked for yet
  std::array<PackedLeaf*, kLeafAhead> leaves_ = {};
  std::array<Waiting, kWaiting> waiting_ = {};
  std::vector<LeafFusion> fusions_;  ///< [kWaiting]
  VoxelVotes fresh_votes_;           ///< of a leaf that has none yet
};

}  // namespace accessvdb::internal
