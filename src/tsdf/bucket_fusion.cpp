// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/bucket_fusion.h"

#include <bit>
#include <span>
#include <utility>

#include "hostdev/flips_hash.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {
namespace {

static_assert(PackedLowerNode::NUM_VALUES == kLeavesPerNode, "bins hold the leaves of whole nodes");
static_assert(ColdLeaves::kBuckets == ReturnBins::kBuckets);

openvdb::Coord coordOf(const std::array<std::int32_t, 3>& ijk) { return {ijk[0], ijk[1], ijk[2]}; }

}  // namespace

void linkNodes(PackedTree& tree, std::vector<std::unique_ptr<PackedLowerNode>>& nodes) {
  using Upper = PackedTree::RootNodeType::ChildNodeType;
  for (auto& node : nodes) {
    auto* upper = tree.root().probeNode<Upper>(node->origin());
    if (upper == nullptr) {
      auto made = std::make_unique<Upper>(node->origin(), tree.background());  // rounds down to its own origin
      upper = made.get();
      tree.root().addChild(made.release());
    }
    upper->addChild(node.release());
  }
}

BucketFusion::BucketFusion(PackedMap& map, const RegionShape& shape) : map_(map) {
  fusions_.reserve(kWaiting);
  for (std::size_t n = 0; n < kWaiting; ++n) fusions_.emplace_back(map, shape);
}

void BucketFusion::locateNodes() {
  nodes_.clear();
  cold_nodes_.assign(bucket_leaves_.nodes.size(), nullptr);
  for (const LeafKey key : bucket_leaves_.nodes) {
    nodes_.push_back(map_.tree().root().probeNode<PackedLowerNode>(coordOf(originOf(key))));
  }
}

void BucketFusion::askForEntry(std::size_t in_bucket) const {
  const LeafPlace place = bucket_leaves_.places[in_bucket];
  const PackedLowerNode* node = nodes_[place.node()];
  if (node == nullptr) return;
  prefetchWrite(node->getTable() + place.inNode(), sizeof(Entry));
  prefetchWrite(reinterpret_cast<const std::byte*>(&node->getChildMask()) + place.inNode() / 8, 1);
}

PackedLeaf* BucketFusion::leafOf(std::size_t in_bucket) const {
  const LeafPlace place = bucket_leaves_.places[in_bucket];
  const PackedLowerNode* node = nodes_[place.node()];
  if (node == nullptr || !node->isChildMaskOn(place.inNode())) return nullptr;
  PackedLeaf* leaf = node->getTable()[place.inNode()].getChild();
  prefetchWrite(leaf, sizeof(PackedLeaf));
  return leaf;
}

/// Where free space ages, most leaves have a record beside their node.
void BucketFusion::askForRecord(const PackedLeaf* leaf) const {
  if (leaf == nullptr) return;
  if (const LeafBits* before = map_.beforeOf(*leaf)) prefetchWrite(before, sizeof(AgedLeaf));
}

PackedLeaf* BucketFusion::addLeaf(std::size_t in_bucket, BucketResult& result) {
  const std::uint32_t number = bucket_leaves_.places[in_bucket].node();
  if (nodes_[number] == nullptr) {
    result.new_nodes.push_back(
        std::make_unique<PackedLowerNode>(coordOf(originOf(bucket_leaves_.nodes[number])), map_.tree().background()));
    nodes_[number] = result.new_nodes.back().get();
  }
  auto leaf = std::make_unique<PackedLeaf>(openvdb::PartialCreate(), coordOf(bucket_leaves_.originOf(in_bucket)));
  PackedLeaf* added = leaf.get();
  {
    const std::lock_guard lock(*leaves_mutex_);
    nodes_[number]->addChild(leaf.release());
  }
  ++result.new_leaves;
  return added;
}

void BucketFusion::fold(LeafFusion& fusion, const Waiting& waiting, BucketChanges& changes, BucketResult& result) {
  LeafChange change;
  bool flipped;
  if (!map_.grows() || !map_.leftOut().empty()) {
    flipped = foldBesideLeftOut(fusion, waiting, change, changes, result);
  } else {
    PackedLeaf* leaf = waiting.leaf != nullptr ? waiting.leaf : addLeaf(waiting.in_bucket, result);
    flipped = foldInto(*leaf, fusion, waiting, change, changes, result);
  }
  if (!flipped) return;
  if (changes.visit) changes.visit(change);
  if (changes.wants_hash) result.flips_hash += kernels::flipsHash(change);
  changes.facts.push_back(change);
}

/// @return whether a fact flipped; then `change` says which
bool BucketFusion::foldInto(PackedLeaf& leaf, LeafFusion& fusion, const Waiting& waiting, LeafChange& change,
                            BucketChanges& changes, BucketResult& result) {
  if (fusion.hasSamples()) openValues(leaf, waiting, result);
  const std::uint32_t touched_pairs = fusion.touchedPairs();
  VoxelVotes* votes = votesFor(fusion, leaf);
  const bool flipped = fusion.fold(leaf, votes, change, result.counts);
  if (votes != nullptr) keepVotes(leaf, votes);
  if (changes.wants_distances && touched_pairs != 0) {
    const openvdb::Coord& origin = leaf.origin();
    changes.distances.push_back(
        {{origin.x(), origin.y(), origin.z()}, touched_pairs, plainValues(leaf), map_.blockedIn(leaf)});
  }
  return flipped;
}

void BucketFusion::openValues(PackedLeaf& leaf, const Waiting& waiting, BucketResult& result) {
  const LeafPlace place = bucket_leaves_.places[waiting.in_bucket];
  ColdLeaves::Node& node = coldNodeOf(place.node());
  const LeafValues values(leaf);
  if (values.plain() != nullptr) return node.touch(place.inNode());
  if (values.compact() != nullptr) {
    map_.cold().makePlain(leaf);
  } else {
    allocateZeroed(leaf);
    ++result.allocated;
  }
  map_.cold().notePlain(bucket_, node, leaf);
}

ColdLeaves::Node& BucketFusion::coldNodeOf(std::uint32_t number) {
  ColdLeaves::Node*& node = cold_nodes_[number];
  if (node == nullptr) node = &map_.cold().nodeOf(bucket_, nodes_[number]);
  return *node;
}

/// The same where returns are, or have been, left out: a leaf's facts are those of the map, except that what was left
/// out in it blocks. Once the map grows again, a return that is fused in a voxel takes the place of what was left out
/// there.
bool BucketFusion::foldBesideLeftOut(LeafFusion& fusion, const Waiting& waiting, LeafChange& change,
                                     BucketChanges& changes, BucketResult& result) {
  PackedLeaf* leaf = waiting.leaf;
  if (!map_.grows() && leaf == nullptr && !fusion.hasSamples()) return false;  // passes make nothing block
  const bool has_place = map_.grows() || (leaf != nullptr && (!leaf->buffer().empty() || !fusion.hasSamples()));
  const openvdb::Coord origin = coordOf(bucket_leaves_.originOf(waiting.in_bucket));
  const LeafBits* found = map_.leftOut().find(origin);
  if (has_place && found == nullptr) {
    if (leaf == nullptr) leaf = addLeaf(waiting.in_bucket, result);
    return foldInto(*leaf, fusion, waiting, change, changes, result);
  }
  const LeafBits before = found != nullptr ? *found : LeafBits{};
  const LeafBits sampled = fusion.sampled();
  LeafBits after;
  for (std::size_t x = 0; x < 8; ++x) {
    const std::uint64_t replaced = map_.grows() ? sampled[x] : 0, left_out = has_place ? 0 : sampled[x];
    after[x] = (before[x] & ~replaced) | left_out;
  }
  const LeafChange old = leaf != nullptr ? factsOf(map_, *leaf) : LeafChange{};
  const std::uint64_t flipped_before = result.counts.flipped_voxels;
  if (!has_place) fusion.dropSamples();
  if (has_place && leaf == nullptr) leaf = addLeaf(waiting.in_bucket, result);
  if (leaf != nullptr) static_cast<void>(foldInto(*leaf, fusion, waiting, change, changes, result));
  const LeafChange now = leaf != nullptr ? factsOf(map_, *leaf) : LeafChange{};
  if (after != before) result.left_out.emplace_back(origin, after);
  if (!map_.leftOut().keeps()) after = before;
  std::uint64_t flips = 0;  // in place of those that foldInto() counted
  for (std::size_t x = 0; x < 8; ++x) {
    const std::uint64_t collided = old.collides_on[x] | before[x], collides = now.collides_on[x] | after[x];
    const std::uint64_t was_free = old.arm_free_on[x] & ~before[x], is_free = now.arm_free_on[x] & ~after[x];
    change.collides_on[x] = collides & ~collided;
    change.collides_off[x] = collided & ~collides;
    change.arm_free_on[x] = is_free & ~was_free;
    change.arm_free_off[x] = was_free & ~is_free;
    flips += static_cast<std::uint64_t>(std::popcount((collides ^ collided) | (is_free ^ was_free)));
  }
  result.counts.flipped_voxels = flipped_before + flips;
  change.origin_ijk = {origin.x(), origin.y(), origin.z()};
  return flips != 0;
}

/// The leaf's votes, or empty ones if the scan may vote; nullptr if neither.
VoxelVotes* BucketFusion::votesFor(const LeafFusion& fusion, const PackedLeaf& leaf) {
  if (!map_.blocksNewThings()) return nullptr;
  if (const std::uint32_t number = map_.voteNumberOf(leaf)) return &map_.votePool()->get(number);
  if (!fusion.foundNews()) return nullptr;
  fresh_votes_ = {};
  return &fresh_votes_;
}

/// Only leaves with votes have a place for them.
void BucketFusion::keepVotes(PackedLeaf& leaf, const VoxelVotes* votes) {
  const bool any = votes->any();
  const std::uint32_t number = map_.voteNumberOf(leaf);
  if (any && number == 0) {
    map_.setVoteNumber(leaf, map_.votePool()->add(*votes));
  } else if (!any && number != 0) {
    map_.votePool()->remove(number);
    map_.setVoteNumber(leaf, 0);
  }
}

void BucketFusion::fuse(const ReturnBins& bins, std::size_t bucket, const ReturnRay* rays, BucketChanges& changes,
                        BucketResult& result, std::mutex& leaves) {
  bucket_ = bucket;
  leaves_mutex_ = &leaves;
  changes.facts.clear();
  changes.distances.clear();
  bins.group(bucket, bucket_leaves_);
  locateNodes();
  const std::size_t count = bucket_leaves_.places.size();
  for (std::size_t g = 0; g < std::min(count, kEntryAhead); ++g) askForEntry(g);
  for (std::size_t g = 0; g < std::min(count, kLeafAhead); ++g) leaves_[g] = leafOf(g);
  const bool ages = map_.agesFreeSpace();
  std::size_t summed = 0, folded = 0;  // leaves actually reached
  for (std::size_t g = 0; g < count; ++g) {
    if (g + kEntryAhead < count) askForEntry(g + kEntryAhead);
    PackedLeaf* leaf = leaves_[g % kLeafAhead];
    if (g + kLeafAhead < count) leaves_[g % kLeafAhead] = leafOf(g + kLeafAhead);
    if (ages && g + kRecordAhead < count) askForRecord(leaves_[(g + kRecordAhead) % kLeafAhead]);
    if (summed - folded == kWaiting) {
      fold(fusions_[folded % kWaiting], waiting_[folded % kWaiting], changes, result);
      ++folded;
    }
    const std::span<const LeafEntry> entries(bucket_leaves_.entries.data() + bucket_leaves_.begin[g],
                                             bucket_leaves_.begin[g + 1] - bucket_leaves_.begin[g]);
    LeafFusion& fusion = fusions_[summed % kWaiting];
    if (!fusion.accumulate(bucket_leaves_.originOf(g), entries, rays)) continue;
    if (leaf != nullptr) {
      fusion.prefetchValues(*leaf);
      if (const VoxelVotes* votes = map_.votesOf(*leaf)) prefetchWrite(votes, sizeof(VoxelVotes));
    }
    waiting_[summed % kWaiting] = {leaf, static_cast<std::uint32_t>(g)};
    ++summed;
  }
  for (; folded < summed; ++folded) {
    fold(fusions_[folded % kWaiting], waiting_[folded % kWaiting], changes, result);
  }
  result.touched += summed;
  map_.cold().look(bucket, leaves);
}

}  // namespace accessvdb::internal
