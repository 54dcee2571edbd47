// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fuses the leaves of one bucket into the map, and links the new ones.
///
/// What costs is memory: a scan reaches some hundred thousand leaves, each in another place. So a leaf passes several
/// stations, and a few others pass theirs before it reaches the next: what a station needs was asked for at the one
/// before.
///   1. its entry in the table of the node above it is asked for;
///   2. the entry is read, and the leaf asked for;
///   3. its returns are summed, and the values under the sums asked for;
///   4. the sums are folded.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
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
  std::uint64_t touched = 0, allocated = 0, new_leaves = 0;
  /// With their leaves, but not yet in the tree: that changes nodes which other buckets read.
  std::vector<std::unique_ptr<PackedLowerNode>> new_nodes;
};

/// Of the leaves of one bucket: those with flipped facts, and where anybody asks, those with changed distances.
struct BucketChanges {
  std::vector<LeafChange> facts;
  std::vector<DistanceChange> distances;
  bool wants_distances = false;
  std::function<void(const LeafChange&)> visit;  ///< null: nobody asks; sees each of `facts` while it is in the cache
};

/// Adds nodes to the tree; not while a bucket is being fused. @throws std::bad_alloc
void linkNodes(PackedTree& tree, std::vector<std::unique_ptr<PackedLowerNode>>& nodes);

/// One a thread: its sums are kept.
class BucketFusion {
 public:
  BucketFusion(PackedMap& map, const RegionShape& shape);

  /// Different buckets may be fused at the same time: a node's leaves are all in one.
  /// @param changes  each leaf once; cleared first
  /// @throws std::bad_alloc; then the bucket's leaves are as they were or hold the scan
  void fuse(const ReturnBins& bins, std::size_t bucket, const ReturnRay* rays, BucketChanges& changes,
            BucketResult& result);

 private:
  /// Leaves between two stations. The sums of those that wait stay in the first-level cache; 8 took as long as 4.
  static constexpr std::size_t kEntryAhead = 16, kLeafAhead = 8, kWaiting = 4;

  /// A leaf whose sums wait to be folded.
  struct Waiting {
    PackedLeaf* leaf = nullptr;  ///< nullptr: it is new
    std::uint32_t group = 0;
  };
  using Entry = PackedLowerNode::UnionType;

  void locateNodes();
  void askForEntry(std::size_t group) const;
  [[nodiscard]] PackedLeaf* leafOf(std::size_t group) const;
  PackedLeaf* addLeaf(std::size_t group, BucketResult& result);
  void fold(LeafFusion& fusion, const Waiting& waiting, BucketChanges& changes, BucketResult& result);

  PackedMap& map_;
  LeafGroups groups_;
  std::vector<PackedLowerNode*> nodes_;  ///< [groups_.nodes] nullptr where the tree has none yet
  std::array<PackedLeaf*, kLeafAhead> leaves_ = {};
  std::array<Waiting, kWaiting> waiting_ = {};
  std::vector<LeafFusion> fusions_;  ///< [kWaiting]
};

}  // namespace accessvdb::internal
