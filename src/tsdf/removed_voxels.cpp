// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/removed_voxels.h"

#include <algorithm>
#include <bit>
#include <memory>

#include "tsdf/leaf_bits.h"
#include "tsdf/leaf_facts.h"
#include "tsdf/return_bins.h"

namespace accessvdb::internal {
namespace {

bool anyFlip(const LeafChange& change) { return flippedVoxels(change) != 0; }

void notePlain(PackedMap& map, PackedLeaf& leaf) {
  const openvdb::Coord& origin = leaf.origin();
  const std::size_t bucket = ReturnBins::bucketOf(leafKeyOf(origin.x() >> 3, origin.y() >> 3, origin.z() >> 3));
  ColdLeaves& cold = map.cold();
  cold.notePlain(bucket, cold.nodeOf(bucket, map.tree().root().probeNode<PackedLowerNode>(origin)), leaf);
}

/// Edits each leaf of the set. @param edit  (leaf, bits, its votes or nullptr)
template <typename Edit>
std::vector<LeafChange> edited(PackedMap& map, const VoxelSet& voxels, const Edit& edit) {
  std::vector<LeafChange> changes;
  for (const LeafVoxels& part : voxels) {
    PackedLeaf* leaf = map.tree().probeLeaf(part.origin_ijk);
    if (leaf == nullptr) continue;
    const LeafChange before = factsWithLeftOut(map, *leaf);
    const std::uint32_t number = map.voteNumberOf(*leaf);
    VoxelVotes* votes = number == 0 ? nullptr : &map.votePool()->get(number);
    const bool was_compact = LeafValues(*leaf).compact() != nullptr;
    edit(*leaf, part.bits, votes);
    if (was_compact) notePlain(map, *leaf);
    if (votes != nullptr && !votes->any()) {
      map.votePool()->remove(number);
      map.setVoteNumber(*leaf, 0);
    }
    const LeafChange after = factsWithLeftOut(map, *leaf);
    LeafChange change;
    change.origin_ijk = before.origin_ijk;
    for (std::size_t x = 0; x < 8; ++x) {
      change.collides_on[x] = after.collides_on[x] & ~before.collides_on[x];
      change.collides_off[x] = before.collides_on[x] & ~after.collides_on[x];
      change.arm_free_on[x] = after.arm_free_on[x] & ~before.arm_free_on[x];
      change.arm_free_off[x] = before.arm_free_on[x] & ~after.arm_free_on[x];
    }
    if (anyFlip(change)) changes.push_back(change);
  }
  return changes;
}

}  // namespace

std::uint64_t countBits(const LeafBits& bits) {
  std::uint64_t count = 0;
  for (const std::uint64_t word : bits) count += static_cast<std::uint64_t>(std::popcount(word));
  return count;
}

std::uint64_t countVoxels(const VoxelSet& voxels) {
  std::uint64_t count = 0;
  for (const LeafVoxels& part : voxels) count += countBits(part.bits);
  return count;
}

std::uint64_t flippedVoxels(const LeafChange& change) {
  LeafBits any;
  for (std::size_t x = 0; x < 8; ++x) {
    any[x] = change.collides_on[x] | change.collides_off[x] | change.arm_free_on[x] | change.arm_free_off[x];
  }
  return countBits(any);
}

VoxelSet unionOf(const VoxelSet& a, const VoxelSet& b) {
  VoxelSet joined;
  joined.reserve(a.size() + b.size());
  auto from_a = a.begin();
  auto from_b = b.begin();
  while (from_a != a.end() || from_b != b.end()) {
    const bool take_a = from_b == b.end() || (from_a != a.end() && from_a->origin_ijk <= from_b->origin_ijk);
    const bool take_b = from_a == a.end() || (from_b != b.end() && from_b->origin_ijk <= from_a->origin_ijk);
    LeafVoxels part = take_a ? *from_a : *from_b;
    if (take_a && take_b) {
      for (std::size_t x = 0; x < 8; ++x) part.bits[x] |= from_b->bits[x];
    }
    joined.push_back(part);
    if (take_a) ++from_a;
    if (take_b) ++from_b;
  }
  return joined;
}

bool contains(const VoxelSet& voxels, const openvdb::Coord& ijk) {
  const openvdb::Coord origin(ijk.x() & ~7, ijk.y() & ~7, ijk.z() & ~7);
  const auto part = std::lower_bound(voxels.begin(), voxels.end(), origin,
                                     [](const LeafVoxels& leaf, const auto& at) { return leaf.origin_ijk < at; });
  if (part == voxels.end() || part->origin_ijk != origin) return false;
  const openvdb::Index voxel = PackedLeaf::coordToOffset(ijk);
  return (part->bits[voxel >> 6] >> (voxel & 63) & 1) != 0;
}

void forEachDistanceLeaf(const PackedMap& map,
                         const std::function<void(std::span<const DistanceChange> distances)>& take) {
  constexpr std::size_t kLeavesPerPart = 1024;
  const auto rooms = std::make_unique_for_overwrite<LeafValues::Room[]>(kLeavesPerPart);
  std::vector<const PackedLeaf*> leaves;
  map.tree().getNodes(leaves);
  std::vector<DistanceChange> part;
  for (std::size_t n = 0; n < leaves.size(); ++n) {
    if (LeafValues(*leaves[n])) part.push_back(distancesOf(map, *leaves[n], rooms[part.size()]));
    if (part.size() < kLeavesPerPart && n + 1 < leaves.size()) continue;
    take(part);
    part.clear();
  }
}

std::vector<LeafChange> flipsIfFree(const PackedMap& map, const VoxelSet& voxels) {
  std::vector<LeafChange> changes;
  for (const LeafVoxels& part : voxels) {
    const PackedLeaf* leaf = map.tree().probeConstLeaf(part.origin_ijk);
    if (leaf == nullptr) continue;
    const LeafChange facts = factsOf(map, *leaf);
    const LeafBits* left_out = map.leftOut().find(part.origin_ijk);
    LeafChange change;
    change.origin_ijk = facts.origin_ijk;
    for (std::size_t x = 0; x < 8; ++x) {
      const std::uint64_t may = left_out == nullptr ? part.bits[x] : part.bits[x] & ~(*left_out)[x];
      change.collides_off[x] = may & facts.collides_on[x];
      change.arm_free_on[x] = may & ~facts.arm_free_on[x];
    }
    if (anyFlip(change)) changes.push_back(change);
  }
  return changes;
}

std::vector<LeafChange> removeAsUnknown(PackedMap& map, const VoxelSet& voxels) {
  return edited(map, voxels, [&map](PackedLeaf& leaf, const LeafBits& bits, VoxelVotes* votes) {
    std::uint32_t* packed = map.openValues(leaf);
    forEachBit(bits, [&](std::size_t n) {
      if (weightOf(packed[n]) > 0) packed[n] = packVoxel(meanOf(packed[n]), 1);
    });
    if (votes == nullptr) return;
    for (std::size_t word = 0; word < bits.size(); ++word) {
      const std::uint64_t blocked = votes->blocked(word), rest = ~bits[word];
      votes->bit[0][word] = (votes->bit[0][word] & rest) | (blocked & bits[word]);  // 3: the last denial frees it
      votes->bit[1][word] = (votes->bit[1][word] & rest) | (blocked & bits[word]);
      votes->bit[2][word] &= rest;
    }
  });
}

std::vector<LeafChange> removeAsFree(PackedMap& map, const VoxelSet& voxels) {
  return edited(map, voxels, [&map](PackedLeaf& leaf, const LeafBits& bits, VoxelVotes* votes) {
    std::uint32_t* packed = map.openValues(leaf);
    forEachBit(bits, [&](std::size_t n) {
      if (weightOf(packed[n]) == 0) return;
      packed[n] = 0;
      --map.observed_voxels;
      leaf.getValueMask().setOn(static_cast<openvdb::Index>(n));
    });
    if (votes == nullptr) return;
    for (LeafBits& plane : votes->bit) {
      for (std::size_t word = 0; word < bits.size(); ++word) plane[word] &= ~bits[word];
    }
  });
}

}  // namespace accessvdb::internal
