// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/packed_map.h"

#include <memory>

#include "tsdf/leaf_kernels.h"

namespace accessvdb::internal {
namespace {

/// Only leaves whose record says something have one. @param records  the pool, or a batch of it
/// @param change  (AgedLeaf&)
template <typename Records, typename Change>
void changeRecord(Records& records, PackedLeaf& leaf, const Change& change) {
  const std::uint32_t number = leaf.transientData();
  if (number == 0) {
    AgedLeaf record;
    change(record);
    if (record.any()) leaf.setTransientData(records.add(record));
    return;
  }
  AgedLeaf& record = records.get(number);
  change(record);
  if (record.any()) return;
  records.remove(number);
  leaf.setTransientData(0);
}

}  // namespace

PackedMap::PackedMap(const TsdfParams& resolved)
    : params_(resolved),
      tree_(PackedVoxel(0)),
      clamp_min_m_(static_cast<float>(resolved.clamp_min_m)),
      step_m_(static_cast<float>((resolved.truncation_distance_m - resolved.clamp_min_m) / kMeanSteps)) {}

PackedMap::~PackedMap() = default;

/// The least mean whose distance is at least this; kMeanSteps + 1 if none is.
std::uint32_t PackedMap::leastMeanAt(float distance_m) const {
  std::uint32_t low = 0, high = kMeanSteps + 1;  // distanceOf() is monotone
  while (low < high) {
    const std::uint32_t middle = (low + high) / 2;
    if (distanceOf(middle) >= distance_m) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

void PackedMap::setCollisionDistance(float r_c_m) { collision_mean_ = leastMeanAt(r_c_m); }

void PackedMap::blockNewThings(float far_m) {
  news_.collision_mean = collision_mean_;
  news_.far_mean = leastMeanAt(far_m);
  votes_ = std::make_unique<VotePool>();
}

void PackedMap::ageFreeSpace(double free_for_s) { generations_ = std::make_unique<FreeGenerations>(free_for_s); }

void PackedMap::setVoteNumber(PackedLeaf& leaf, std::uint32_t number) {
  if (generations_ == nullptr) {
    leaf.setTransientData(number);
  } else {
    changeRecord(generations_->records(), leaf, [number](AgedLeaf& record) { record.votes = number; });
  }
}

void PackedMap::setBefore(PackedLeaf& leaf, const LeafBits& before) {
  changeRecord(generations_->records(), leaf, [&before](AgedLeaf& record) { record.before = before; });
}
void PackedMap::setBefore(PackedLeaf& leaf, const LeafBits& before, RecordPool<AgedLeaf>::Batch& records) {
  changeRecord(records, leaf, [&before](AgedLeaf& record) { record.before = before; });
}

std::uint64_t PackedMap::agedLeafCount() const {
  std::uint64_t count = 0;
  if (generations_ == nullptr) return count;
  for (auto leaf = tree_.cbeginLeaf(); leaf; ++leaf) {
    const LeafBits* before = beforeOf(*leaf);
    count += before != nullptr && *before != LeafBits{} ? 1 : 0;
  }
  return count;
}

LeafBits PackedMap::confirmedIn(const PackedLeaf& leaf) const {
  LeafBits confirmed;
  const LeafBits* before = beforeOf(leaf);
  for (std::size_t x = 0; x < 8; ++x) {
    confirmed[x] = leaf.getValueMask().getWord<std::uint64_t>(static_cast<openvdb::Index>(x));
    if (before != nullptr) confirmed[x] |= (*before)[x];
  }
  return confirmed;
}

LeafBits PackedMap::collidingIn(const PackedLeaf& leaf) const {
  LeafBits collides = blockedIn(leaf);
  LeafValues::Room room;
  const std::uint32_t* packed = LeafValues(leaf).all(room);
  if (packed == nullptr) return collides;
  KernelConstants constants = {};
  constants.collision_mean = static_cast<std::int32_t>(collision_mean_);
  leafKernels().mark_colliding(packed, constants, ~std::uint32_t{0}, collides);
  return collides;
}

VoxelState PackedMap::at(const openvdb::Coord& ijk) const {
  VoxelState state;
  state.distance_m = static_cast<float>(params_.truncation_distance_m);
  const PackedLeaf* leaf = tree_.probeConstLeaf(ijk);
  if (leaf == nullptr) return state;
  state.cleared = isKnownFree(*leaf, PackedLeaf::coordToOffset(ijk));
  if (const LeafValues values(*leaf); values) {
    const std::uint32_t packed = values[PackedLeaf::coordToOffset(ijk)];
    state.weight = weightOf(packed);
    if (state.weight > 0) state.distance_m = distanceOf(meanOf(packed));
    const VoxelVotes* votes = votesOf(*leaf);
    if (votes != nullptr && votes->blockedAt(PackedLeaf::coordToOffset(ijk))) {
      state.blocked = true;
      state.distance_m = 0;
    }
  }
  return state;
}

PackedLeaf* PackedMap::restoreLeaf(const openvdb::Coord& origin_ijk, const LeafBits& cleared,
                                   const std::uint32_t* packed, const VoxelVotes* votes, const LeafBits* before) {
  if (tree_.probeConstLeaf(origin_ijk) != nullptr) return nullptr;
  auto leaf = std::make_unique<PackedLeaf>(openvdb::PartialCreate(), origin_ijk);
  if (leaf->origin() != origin_ijk) return nullptr;
  for (openvdb::Index x = 0; x < 8; ++x) leaf->getValueMask().getWord<std::uint64_t>(x) = cleared[x];
  if (packed != nullptr) {
    std::uint32_t observed = 0, wrong = 0;
    for (std::size_t n = 0; n < PackedLeaf::SIZE; ++n) {
      const std::uint32_t weight = weightOf(packed[n]);
      observed += weight != 0 ? 1u : 0u;
      wrong |=
          weight > params_.max_weight || meanOf(packed[n]) > kMeanSteps || (weight == 0 && packed[n] != 0) ? 1u : 0u;
    }
    if (wrong != 0) return nullptr;
    cold_.put(*leaf, packed);
    observed_voxels += observed;
    ++allocated_leaf_count;
  }
  if (votes != nullptr) {
    if (votes_ == nullptr || packed == nullptr || !votes->any()) return nullptr;
    for (std::size_t n = 0; n < PackedLeaf::SIZE; ++n) {
      std::uint64_t has = 0;
      for (const LeafBits& bits : votes->bit) has |= bits[n >> 6] >> (n & 63) & 1;
      if (has != 0 && weightOf(packed[n]) == 0) return nullptr;  // only observed voxels have votes
    }
    setVoteNumber(*leaf, votes_->add(*votes));
  }
  if (before != nullptr) {
    if (generations_ == nullptr || *before == LeafBits{}) return nullptr;
    setBefore(*leaf, *before);
  }
  ++leaf_count;
  PackedLeaf* added = leaf.release();
  tree_.addLeaf(added);
  return added;
}

std::uint64_t PackedMap::memoryBytes() const {
  std::uint64_t bytes = leaf_count * kClearedLeafBytes + cold_.bytes() +
                        (allocated_leaf_count - cold_.leaves()) * (kObservedLeafBytes - kClearedLeafBytes);
  if (votes_ != nullptr) bytes += votes_->bytes();
  if (generations_ != nullptr) bytes += generations_->records().bytes();
  if (!left_out_.empty()) bytes += left_out_.bytes();
  // Not nodeCount(), which looks at every lower node: a live map asks this after every scan.
  for (auto upper = tree_.root().cbeginChildOn(); upper; ++upper) {
    bytes += sizeof(PackedUpperNode) + upper->getChildMask().countOn() * sizeof(PackedLowerNode);
  }
  return bytes;
}

}  // namespace accessvdb::internal
