// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/leading_map.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "accessvdb/error.h"
#include "field/backend_choice.h"
#include "field/point_weights.h"
#include "mirror/host_topology.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kRaysPerTask = 256;

constexpr const char* kDiverged = "device.diverged";

/// Bytes that a scan adds to the map and its mirror, at most: as if all that it reached were new.
std::uint64_t atMostBytes(const kernels::FusedScan& fused, const kernels::GridSpace& space) {
  const kernels::GrowthCounts added = fused.growth.counts();
  constexpr std::uint64_t kListed = 64;  // in what the topology keeps of a leaf
  constexpr std::uint64_t kOfLeaf = kObservedLeafBytes + sizeof(VoxelVotes) + sizeof(std::uint32_t) + kListed;
  return fused.touched_leaves * kOfLeaf + added.lowers * (sizeof(PackedLowerNode) + sizeof(InternalShadow<4>)) +
         added.uppers * (sizeof(PackedUpperNode) + sizeof(InternalShadow<5>)) + kernels::growthBytes(space, added);
}

}  // namespace

void throwDiverged() {
  throw DeviceError(kDiverged, "cuda", "the map on the GPU is no longer that on the host",
                    "Check the memory of the GPU (nvidia-smi), or use BackendKind::Cpu");
}

HeldByMap heldBy(const PackedMap& map) {
  HeldByMap held;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord& ijk = leaf->origin();
    const kernels::GridGrowth::Origin origin = {ijk.x(), ijk.y(), ijk.z()};
    if (LeafValues(*leaf)) held.with_values.push_back(origin);
    const VoxelVotes* const votes = map.votesOf(*leaf);
    if (votes == nullptr) continue;
    kernels::VotesRecord& record = held.votes.emplace_back();
    record.origin_ijk = origin;
    static_assert(sizeof(record.votes) == sizeof(votes->bit));
    std::memcpy(record.votes, votes->bit.data(), sizeof(record.votes));
  }
  return held;
}

bool LeadingMap::mayLead(const FieldParams& resolved) {
  const TsdfParams& tsdf = resolved.tsdf;
  return resolved.update.policy == UpdatePolicy::Exact && resolved.change.mode != ChangeMode::Full &&
         !std::isfinite(resolved.change.free_for_s) && tsdf.region != UpdateRegion::Projective &&
         !resolved.mirror_distance && !resolved.window && !(tsdf.clear_rays_m > 0) && !(tsdf.platform_radius_m > 0);
}

LeadingMap::LeadingMap(std::unique_ptr<kernels::ScanFuser> fuser, PackedMap& map, ScanIntegrator& integrator,
                       NanoVdbMirror& facts, const FieldParams& resolved)
    : map_(map),
      integrator_(integrator),
      facts_(facts),
      fuser_(std::move(fuser)),
      follower_([this](const MapFollower::Scan& scan) { return takeIntoMap(scan); }, resolved.threads) {
  if (map.leaf_count > 0) {
    const HeldByMap held = heldBy(map);
    fuser_->begin(facts.space(), held.with_values, held.votes);
  }
  integrator_.hashFlips(true);
}

LeadingMap::~LeadingMap() = default;

void LeadingMap::prepare(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  rays_.resize(p_L.size());
  const double v = map_.params().voxel_size_m;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), kRaysPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      rays_[n] = makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), v);
    }
  });
  prepared_ = true;
}

std::optional<kernels::FusedScan> LeadingMap::fuse(std::span<const Eigen::Vector3f> p_L,
                                                   std::span<const Eigen::Vector3f> q_L, const ScanFrame& frame) {
  if (!std::exchange(prepared_, false)) prepare(p_L, q_L);
  if (!std::exchange(knows_space_, true)) space_ = facts_.space();
  kernels::FusedScan fused;
  try {
    fused = fuser_->fuse(
        rays_, 0, space_, [this](std::uint64_t more_bytes) { reserve(more_bytes); }, *this);
  } catch (const ResourceLimit&) {
    leave();
    return std::nullopt;
  } catch (const DeviceError& error) {
    if (error.id() != kDiverged) {
      takeOnHost(p_L, q_L, frame);
      throw;
    }
    differs_ = true;
    leave();
    return std::nullopt;
  } catch (const InternalError&) {  // a mirror of which nobody knows what it holds takes nothing any more
    if (!differs_) throw;
    leave();
    return std::nullopt;
  }
  returning_.note(fused.returned_leaves, fused.touched_leaves);
  const std::uint64_t at_most_bytes = atMostBytes(fused, space_);
  space_ = kernels::grown(space_, fused.growth.counts());
  const kernels::GridGrowth& added = fused.growth;
  {
    const std::lock_guard lock(mutex_);
    if (growths_.empty()) held_bytes_ = heldNow();  // others may have changed the map
    growths_.push_back({{added.uppers.begin(), added.uppers.end()},
                        {added.lowers.begin(), added.lowers.end()},
                        {added.leaves.begin(), added.leaves.end()},
                        at_most_bytes});
  }
  scan_.p_L.assign(p_L.begin(), p_L.end());
  scan_.q_L.assign(q_L.begin(), q_L.end());
  scan_.frame = frame;
  follower_.take(scan_, fused.flips_hash);
  return fused;
}

void LeadingMap::takeOnHost(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                            const ScanFrame& frame) {
  leave();
  integrator_.integrate(p_L, q_L, frame);
}

/// On the follower's thread.
std::uint64_t LeadingMap::takeIntoMap(const MapFollower::Scan& scan) {
  const std::uint64_t hash = integrator_.integrate(scan.p_L, scan.q_L, scan.frame).flips_hash;
  const std::lock_guard lock(mutex_);
  const Growth& growth = growths_.front();
  // Isolated: a thread that waits here must not begin other work, which may want the mutex.
  tbb::this_task_arena::isolate([&] {
    if (differs_) return;
    try {
      facts_.adopt({growth.uppers, growth.lowers, growth.leaves});
    } catch (const InternalError&) {  // only the device's map is wrong
      differs_ = true;
    }
  });
  growths_.pop_front();
  held_bytes_ = heldNow();
  return hash;
}

void LeadingMap::reserve(std::uint64_t more_bytes) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t end = space_.top_bytes + more_bytes;
  if (end > facts_.committedBytes()) facts_.reserve(end - facts_.usedBytes());
}

void LeadingMap::readWeightsAt(std::span<const Index3> voxels, int reach, std::span<std::uint16_t> weights) {
  static_assert(std::is_same_v<Index3, kernels::GridGrowth::Origin>);
  // So many are of all points, of which the device may not have the values.
  constexpr std::size_t kMany = std::size_t{1} << 19;
  if (voxels.size() >= kMany && hostHasAll()) {
    readWeightsOfMap(map_, reach, voxels, weights);
    return;
  }
  const std::lock_guard lock(asking_);
  // Isolated: as in takeIntoMap().
  tbb::this_task_arena::isolate([&] {
    try {
      fuser_->readWeights(voxels, reach, weights, *this);
    } catch (const Error& error) {
      if (!isOfDevice(error)) throw;
      // Whatever else needs the device will say so. Points without labels, which are saved then, do not.
      if (error.code() == ErrorCode::Device) leave();
      if (error.id() == kDiverged) throw;
      follower_.join();
      readWeightsOfMap(map_, reach, voxels, weights);
    }
  });
}

void LeadingMap::read(std::span<kernels::LeafRecord> leaves) {
  std::vector<Index3> origins(leaves.size());
  std::transform(leaves.begin(), leaves.end(), origins.begin(), [](const auto& record) { return record.origin_ijk; });
  std::atomic<bool> has_all = true;
  integrator_.readLeaves(origins, [&](std::size_t n, const PackedLeaf* leaf) {
    kernels::LeafRecord& record = leaves[n];
    LeafValues::Room room;
    const std::uint32_t* values = leaf == nullptr ? nullptr : LeafValues(*leaf).all(room);
    if (values == nullptr) {
      has_all = false;
      return;
    }
    std::copy_n(values, std::size(record.values), record.values);
    for (openvdb::Index word = 0; word < 8; ++word) {
      const auto bits = leaf->getValueMask().getWord<std::uint64_t>(word);
      std::memcpy(record.cleared + std::size_t{2} * word, &bits, sizeof(bits));
    }
  });
  if (!has_all) throwDiverged();
}

MapBytes LeadingMap::mapBytes() {
  const std::lock_guard lock(mutex_);
  if (growths_.empty()) return {heldNow(), 0};
  // What the host keeps of the mirror's topology is in containers that may double, or get a slab each (NodePool).
  constexpr std::uint64_t kSlabs = std::uint64_t{4} * 2 << 20;
  MapBytes bytes = {held_bytes_, facts_.hostBytes() + kSlabs};
  for (const Growth& growth : growths_) bytes.at_most_more += growth.at_most_bytes;
  return bytes;
}

void LeadingMap::catchUp() {
  follower_.join();
  knows_space_ = false;
}

void LeadingMap::stop() { leave(); }

void LeadingMap::leave() {
  follower_.join();
  knows_space_ = false;
  leads_ = false;
  integrator_.hashFlips(false);
}

}  // namespace accessvdb::internal
