// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/scan_on_device.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <stdexcept>
#include <utility>

#include "cuda/fusion/leaf_slots.h"
#include "field/leading_map.h"
#include "launch/leaf_patch.h"
#include "launch/stopwatch.h"
#include "tsdf/leaf_facts.h"
#include "tsdf/leaf_fusion.h"
#include "tsdf/platform_balls.h"
#include "tsdf/return_bins.h"
#include "tsdf/scan_news.h"
#include "update/waiting_flips.h"

namespace accessvdb::test {
namespace {

constexpr std::size_t kValues = 512, kCleared = 16, kVotes = 48;
static_assert(sizeof(internal::VoxelVotes) == kVotes * sizeof(std::uint32_t));

/// Nodes of a grid are aligned to it.
struct alignas(NANOVDB_DATA_ALIGNMENT) GridUnit {
  std::byte bytes[NANOVDB_DATA_ALIGNMENT];
};

LeafBits maskOf(const internal::PackedLeaf& leaf) {
  LeafBits bits;
  for (openvdb::Index word = 0; word < 8; ++word) bits[word] = leaf.getValueMask().getWord<std::uint64_t>(word);
  return bits;
}

std::uint64_t differs(const void* a, const void* b, std::size_t bytes) { return std::memcmp(a, b, bytes) == 0 ? 0 : 1; }

std::uint32_t weightAt(const internal::PackedMap& map, const openvdb::Coord& ijk) {
  const internal::PackedLeaf* leaf = map.tree().probeConstLeaf(ijk);
  internal::LeafValues::Room room;
  const std::uint32_t* values = leaf == nullptr ? nullptr : internal::LeafValues(*leaf).all(room);
  return values == nullptr ? 0 : kernels::weightOf(values[internal::PackedLeaf::coordToOffset(ijk)]);
}

std::uint16_t largestWeight(const internal::PackedMap& map, const kernels::GridGrowth::Origin& voxel, int reach) {
  std::uint32_t most = 0;
  for (int x = -reach; x <= reach; ++x) {
    for (int y = -reach; y <= reach; ++y) {
      for (int z = -reach; z <= reach; ++z) {
        most = std::max(most, weightAt(map, {voxel[0] + x, voxel[1] + y, voxel[2] + z}));
      }
    }
  }
  const bool is_observed = weightAt(map, {voxel[0], voxel[1], voxel[2]}) > 0;
  return static_cast<std::uint16_t>(is_observed ? most : 0);
}

void requireThat(bool holds) {
  if (!holds) throw std::logic_error("the device asked for a leaf without values");
}

/// What is said of each leaf, with its voxels named, by its place.
std::map<std::array<std::int32_t, 3>, std::pair<kernels::LeafFlips, std::vector<std::uint16_t>>> byPlace(
    const std::vector<kernels::LeafFlips>& leaves, const std::vector<std::uint16_t>& voxels) {
  std::map<std::array<std::int32_t, 3>, std::pair<kernels::LeafFlips, std::vector<std::uint16_t>>> by_place;
  for (const kernels::LeafFlips& leaf : leaves) {
    const auto first = voxels.begin() + leaf.first_voxel;
    std::vector<std::uint16_t> of_leaf(first, first + leaf.voxels);
    std::sort(of_leaf.begin(), of_leaf.end());
    by_place[{leaf.leaf[0], leaf.leaf[1], leaf.leaf[2]}] = {leaf, std::move(of_leaf)};
  }
  return by_place;
}

bool same(const kernels::LeafFlips& a, const kernels::LeafFlips& b) {
  return a.kinds == b.kinds && a.freed_heights == b.freed_heights && a.blocked_heights == b.blocked_heights &&
         a.freed == b.freed && a.freed_columns == b.freed_columns && a.blocked_columns == b.blocked_columns;
}

/// Takes note of a slot. @return 1 if it is out of range or another leaf's
std::uint64_t isTaken(std::vector<bool>& taken, std::uint32_t slot) {
  if (slot >= taken.size() || taken[slot]) return 1;
  taken[slot] = true;
  return 0;
}

internal::NanoVdbMirror mirrorIn(std::unique_ptr<kernels::MirrorArena> arena, double voxel_size_m,
                                 kernels::MirrorArena** of) {
  *of = arena.get();
  return internal::NanoVdbMirror(std::move(arena), voxel_size_m);
}

}  // namespace

MapBehind::MapBehind(std::unique_ptr<internal::PackedMap> map, std::size_t scans_behind)
    : map_(std::move(map)), integrator_(*map_), behind_(scans_behind) {}

void MapBehind::take(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L) {
  waiting_.push_back({{p_L.begin(), p_L.end()}, {q_L.begin(), q_L.end()}});
  catchUp(behind_);
}

void MapBehind::catchUp(std::size_t behind) {
  for (; waiting_.size() > behind; waiting_.pop_front(), ++scans_) {
    integrator_.integrate(waiting_.front().p_L, waiting_.front().q_L);
  }
}

void MapBehind::read(std::span<kernels::LeafRecord> leaves) {
  leaves_read_ += leaves.size();
  for (kernels::LeafRecord& record : leaves) {
    const auto& [x, y, z] = record.origin_ijk;
    const internal::PackedLeaf* leaf = map_->tree().probeConstLeaf({x, y, z});
    requireThat(leaf != nullptr);
    internal::LeafValues::Room room;
    const std::uint32_t* values = internal::LeafValues(*leaf).all(room);
    requireThat(values != nullptr);
    std::copy_n(values, kValues, record.values);
    std::memcpy(record.cleared, maskOf(*leaf).data(), sizeof(record.cleared));
  }
}

ScanOnDevice::ScanOnDevice(kernels::CudaBackend& backend, const internal::PackedMap& map, MapBehind& behind,
                           std::uint64_t cache_bytes)
    : backend_(backend),
      behind_(behind),
      mirror_(mirrorIn(backend.makeArena(), map.params().voxel_size_m, &arena_)),
      shape_(map.params()),
      cache_bytes_(cache_bytes) {
  space_.top_bytes = mirror_.usedBytes();
  space_.root_capacity = internal::NanoVdbMirror::kDefaultRootCapacity;
  fuser_ = makeFuser(map);
}

std::unique_ptr<kernels::DeviceScanFuser> ScanOnDevice::makeFuser(const internal::PackedMap& map) {
  kernels::FusionSetting setting;
  setting.region = shape_;
  setting.constants = internal::kernelConstants(map, shape_);
  setting.news = map.newsRule();
  setting.votes = map.blocksNewThings();
  setting.cache_bytes = cache_bytes_;
  return backend_.makeDeviceScanFuser(setting, mirror_.grid());
}

void ScanOnDevice::beginAgain(const internal::PackedMap& map) {
  behind_.beginAgain();
  fuser_ = makeFuser(map);
  const internal::HeldByMap held = internal::heldBy(map);
  fuser_->begin(space_, held.with_values, held.votes);
}

void ScanOnDevice::fuse(const internal::PackedMap& map, std::span<const Eigen::Vector3f> p_L,
                        std::span<const Eigen::Vector3f> q_L) {
  rays_.clear();
  for (std::size_t n = 0; n < p_L.size(); ++n) {
    rays_.push_back(internal::makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), map.params().voxel_size_m));
  }
  const internal::PlatformBalls platform = internal::platformBalls(map, shape_, rays_, q_L);
  std::vector<kernels::ReturnRay> marked = rays_;
  if (map.blocksNewThings()) internal::markNews(map, marked);
  news_ = 0;
  for (const kernels::ReturnRay& ray : marked) news_ += ray.news;
  rays_.insert(rays_.end(), platform.balls.begin(), platform.balls.end());
  fuser_->clearFlips();
  const kernels::Stopwatch calling;
  last_ = fuser_->fuse(
      rays_, static_cast<std::uint32_t>(platform.balls.size()), space_,
      [this](std::uint64_t more_bytes) { arena_->commit(space_.top_bytes + more_bytes); }, behind_);
  call_ms_ = calling.milliseconds();
  rays_.resize(rays_.size() - platform.balls.size());
  behind_.take(p_L, q_L);
  space_ = kernels::grown(space_, last_.growth.counts());
}

std::uint64_t ScanOnDevice::wideLeafCount() {
  internal::ReturnBins bins;
  bins.bin(shape_, rays_);
  std::uint64_t wide = 0;
  internal::BucketLeaves group;
  for (std::size_t bucket = 0; bucket < internal::ReturnBins::kBuckets; ++bucket) {
    bins.group(bucket, group);
    for (std::size_t n = 0; n < group.places.size(); ++n) {
      const auto begin = group.entries.begin();
      const auto cones = std::count_if(begin + group.begin[n], begin + group.begin[n + 1],
                                       [](kernels::LeafEntry entry) { return entry.cone(); });
      wide += cones > kernels::LeafSums::kMostSamples ? 1 : 0;
    }
  }
  return wide;
}

FusionDifferences ScanOnDevice::compare(const internal::PackedMap& map, const internal::IntegrationResult& result) {
  const std::size_t units = (space_.top_bytes + sizeof(GridUnit) - 1) / sizeof(GridUnit);
  const auto copy = std::make_unique_for_overwrite<GridUnit[]>(units);
  backend_.download(copy.get(), arena_->base(), space_.top_bytes);
  const auto* grid = reinterpret_cast<const kernels::OccupancyGrid*>(copy.get());
  const kernels::DeviceScanFuser::Slots slots = fuser_->readSlots();
  std::vector<bool> taken(slots.values.size() / kValues), votes_taken(slots.votes.size() / kVotes);
  FusionDifferences found;
  on_host_ = 0;
  const auto accessor = grid->tree().getAccessor();
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord& origin = leaf->origin();
    const kernels::OccupancyLeaf* mirrored = accessor.probeLeaf({origin.x(), origin.y(), origin.z()});
    if (mirrored == nullptr) {
      ++found.leaves;
      continue;
    }
    const auto* of_leaf = reinterpret_cast<const std::byte*>(mirrored->data());
    std::array<std::uint64_t, 17> words;
    kernels::LeafSlots own;
    std::memcpy(words.data(), of_leaf + kernels::kLeafBitsBytes, sizeof(words));
    std::memcpy(&own, of_leaf + kernels::kLeafSlotsBytes, sizeof(own));
    const LeafChange facts = internal::factsOf(map, *leaf);
    found.facts += differs(words.data(), facts.arm_free_on.data(), sizeof(LeafBits)) |
                   differs(words.data() + 8, facts.collides_on.data(), sizeof(LeafBits)) |
                   (words[16] != kernels::countCells(words.data() + 8) ? 1 : 0);
    internal::LeafValues::Room room;
    const std::uint32_t* values = internal::LeafValues(*leaf).all(room);
    if ((values != nullptr) != (own.values_plus_one != 0)) {
      ++found.leaves;
    } else if (own.values_plus_one == kernels::LeafSlots::kOnHost) {
      ++on_host_;
    } else if (values != nullptr) {
      const std::size_t slot = own.values_plus_one - 1;
      found.leaves += isTaken(taken, own.values_plus_one - 1);
      found.values += differs(values, slots.values.data() + kValues * slot, kValues * sizeof(std::uint32_t));
      found.cleared += differs(maskOf(*leaf).data(), slots.cleared.data() + kCleared * slot, sizeof(LeafBits));
    }
    const internal::VoxelVotes* votes = map.blocksNewThings() ? map.votesOf(*leaf) : nullptr;
    if ((votes != nullptr) != (own.votes_plus_one != 0)) {
      ++found.votes;
    } else if (votes != nullptr) {
      const std::size_t slot = own.votes_plus_one - 1;
      found.votes += isTaken(votes_taken, own.votes_plus_one - 1);
      found.votes += differs(votes->bit.data(), slots.votes.data() + kVotes * slot, sizeof(votes->bit));
    }
  }
  std::uint64_t changed = 0;
  for (const auto& part : result.changes) changed += part.size();
  const auto count = [&found](std::uint64_t on_device, std::uint64_t on_host) {
    found.counts += on_device != on_host ? 1 : 0;
  };
  count(grid->tree().nodeCount(0), map.leaf_count);
  count(grid->tree().nodeCount(0), space_.leaves);
  count(grid->tree().nodeCount(1), space_.lowers);
  count(grid->tree().nodeCount(2), space_.uppers);
  count(last_.touched_leaves, result.touched_leaves);
  count(last_.growth.leaves.size(), result.new_leaves);
  count(last_.changed_leaves, changed);
  count(last_.counts.distance_updates, result.counts.distance_updates);
  count(last_.counts.cleared_updates, result.counts.cleared_updates);
  count(last_.counts.newly_observed, result.counts.newly_observed);
  count(last_.counts.flipped_voxels, result.counts.flipped_voxels);
  count(last_.flips_hash, result.flips_hash);
  compareFlips(result, found);
  compareWeights(map, found);
  return found;
}

void ScanOnDevice::compareFlips(const internal::IntegrationResult& result, FusionDifferences& found) {
  internal::WaitingFlips wanted;
  for (const auto& part : result.changes) {
    for (const LeafChange& change : part) wanted.add(change, true);
  }
  std::vector<kernels::LeafFlips> leaves;
  std::vector<std::uint16_t> voxels;
  fuser_->takeFlips(leaves, voxels);
  found.flips += leaves.size() != wanted.leaves().size() ? 1 : 0;
  const auto on_device = byPlace(leaves, voxels), on_host = byPlace(wanted.leaves(), wanted.voxels());
  for (const auto& [place, flips] : on_host) {
    const auto other = on_device.find(place);
    const bool equal =
        other != on_device.end() && same(other->second.first, flips.first) && other->second.second == flips.second;
    found.flips += equal ? 0 : 1;
  }
}

void ScanOnDevice::compareWeights(const internal::PackedMap& map, FusionDifferences& found) {
  std::vector<kernels::GridGrowth::Origin> voxels;
  for (std::size_t n = 0; n < rays_.size() && voxels.size() < 2000; n += 1 + rays_.size() / 1000) {
    const auto& base = rays_[n].base_ijk;
    voxels.push_back({base[0], base[1], base[2]});
    voxels.push_back({base[0] + 5, base[1] - 7, base[2] + 9});
  }
  for (const int reach : {0, 1}) {
    std::vector<std::uint16_t> weights(voxels.size());
    fuser_->readWeights(voxels, reach, weights, behind_);
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      found.weights += weights[n] != largestWeight(map, voxels[n], reach) ? 1 : 0;
    }
  }
}

}  // namespace accessvdb::test
