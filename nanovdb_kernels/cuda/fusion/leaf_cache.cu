// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Values of leaves on the device: which of them leave when room is short, and what comes back from the host.
#include "cuda/fusion/fusion_views.h"
#include "cuda/fusion/grid_nodes.cuh"
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "hostdev/weight_window.h"

namespace accessvdb::kernels {
namespace {

using nanovdb::Coord;

/// One thread for each lower node that there may be.
__global__ void forgetSlots(std::byte* grid, std::uint32_t uppers) {
  const std::uint64_t thread = std::uint64_t{blockIdx.x} * kFusionThreads + threadIdx.x;
  const std::uint64_t number = thread / OccupancyUpper::SIZE;
  const auto place = static_cast<std::uint32_t>(thread % OccupancyUpper::SIZE);
  if (number >= uppers) return;
  grid_nodes::Root* const root = grid_nodes::rootOf(grid);
  auto* const upper = reinterpret_cast<grid_nodes::Upper*>(reinterpret_cast<std::byte*>(root) +
                                                           grid_nodes::tilesOf(root)[number].child);
  if (!upper->mChildMask.isOn(place)) return;
  auto* const lower =
      reinterpret_cast<grid_nodes::Lower*>(reinterpret_cast<std::byte*>(upper) + upper->mTable[place].child);
  for (std::uint32_t n = 0; n < OccupancyLower::SIZE; ++n) {
    if (lower->mChildMask.isOn(n)) {
      grid_nodes::slotsOf(reinterpret_cast<std::byte*>(lower) + lower->mTable[n].child) = LeafSlots{};
    }
  }
}

__device__ Coord coordOf(const GridGrowth::Origin& origin) {
  const auto* const of = reinterpret_cast<const std::int32_t*>(&origin);
  return {of[0], of[1], of[2]};
}

__global__ void noteOnHost(std::byte* grid, DeviceList<GridGrowth::Origin> leaves) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= leaves.count) return;
  auto* const leaf = reinterpret_cast<std::byte*>(grid_nodes::leafAt(grid, coordOf(leaves.data[n])));
  if (leaf != nullptr) grid_nodes::slotsOf(leaf).values_plus_one = LeafSlots::kOnHost;
}

/// One warp for each record.
__global__ void takeVotes(std::byte* grid, DeviceList<VotesRecord> records, std::uint32_t* votes,
                          std::uint32_t first_slot) {
  const std::uint32_t n = (blockIdx.x * kFusionThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= records.count) return;
  constexpr unsigned kWords = sizeof(VotesRecord::votes) / sizeof(std::uint32_t);
  const VotesRecord& record = records.data[n];
  for (unsigned word = lane; word < kWords; word += kWarp) {
    votes[std::size_t{kWords} * (first_slot + n) + word] = record.votes[word];
  }
  if (lane != 0) return;
  auto* const leaf = reinterpret_cast<std::byte*>(grid_nodes::leafAt(grid, coordOf(record.origin_ijk)));
  if (leaf != nullptr) grid_nodes::slotsOf(leaf).votes_plus_one = first_slot + n + 1;
}

/// One warp for each record.
__global__ void takeRecords(ReachView scan, CacheView cache, SlotsView slots, std::uint32_t first_slot,
                            DeviceList<LeafRecord> records, const std::uint32_t* missed, std::uint32_t scan_number) {
  const std::uint32_t n = (blockIdx.x * kFusionThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= records.count) return;
  const LeafRecord& record = records.data[n];
  const std::uint32_t slot = nthSlot(slots, first_slot + n);
  for (unsigned voxel = lane; voxel < 512; voxel += kWarp) {
    cache.values[std::size_t{512} * slot + voxel] = record.values[voxel];
  }
  if (lane < 16) cache.cleared[std::size_t{16} * slot + lane] = record.cleared[lane];
  if (lane != 0) return;
  FusedLeaf& leaf = scan.leaves[missed[n]];
  leaf.values = slot;
  grid_nodes::slotsOf(grid_nodes::leafAtUnit(scan.grid, leaf.facts)).values_plus_one = slot + 1;
  cache.owner[slot] = leaf.facts;
  cache.stamp[slot] = scan_number;
}

__global__ void keepReached(ReachView scan, CacheView cache, std::uint32_t leaves, std::uint32_t scan_number) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n < leaves && scan.leaves[n].values != FusedLeaf::kNone) cache.stamp[scan.leaves[n].values] = scan_number;
}

__global__ void countAges(CacheView cache, std::uint32_t scan_number, std::uint32_t* by_age) {
  const std::uint32_t slot = blockIdx.x * kFusionThreads + threadIdx.x;
  if (slot >= cache.count || cache.owner[slot] == CacheView::kNobody) return;
  const std::uint32_t age = scan_number - cache.stamp[slot];
  atomicAdd(by_age + (age < CacheView::kAges ? age : CacheView::kAges - 1), 1u);
}

__global__ void evict(CacheView cache, std::uint32_t latest, SlotsView slots, std::uint32_t* freed) {
  const std::uint32_t slot = blockIdx.x * kFusionThreads + threadIdx.x;
  if (slot >= cache.count) return;
  const std::uint32_t owner = cache.owner[slot];
  if (owner == CacheView::kNobody || cache.stamp[slot] > latest) return;
  grid_nodes::slotsOf(grid_nodes::leafAtUnit(cache.grid, owner)).values_plus_one = LeafSlots::kOnHost;
  cache.owner[slot] = CacheView::kNobody;
  slots.free[slots.free_count + atomicAdd(freed, 1u)] = slot;
}

__global__ void largestWeights(CacheView cache, const GridGrowth::Origin* voxels, std::uint32_t count, int reach,
                               std::uint32_t* weights) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= count) return;
  const Coord of = coordOf(voxels[n]);
  const std::int32_t own[3] = {of[0], of[1], of[2]};
  std::uint32_t most = 0, on_host = 0;
  bool is_observed = false;
  for (int part = 0; part < kWindowParts; ++part) {
    const WindowPart window = windowPart(own, reach, part);
    if (window.empty()) continue;
    grid_nodes::Leaf* const leaf =
        grid_nodes::leafAt(cache.grid, Coord(window.first[0] & ~7, window.first[1] & ~7, window.first[2] & ~7));
    const std::uint32_t slot =
        leaf == nullptr ? 0 : grid_nodes::slotsOf(reinterpret_cast<std::byte*>(leaf)).values_plus_one;
    const bool holds_own = window.holds(own);
    if (slot == LeafSlots::kOnHost) {
      on_host |= 1u << (kPartsShift + part);
      is_observed = is_observed || holds_own;  // unless the host says otherwise
    }
    if (slot == 0 || slot == LeafSlots::kOnHost) continue;
    const std::uint32_t* const values = cache.values + std::size_t{512} * (slot - 1);
    const auto weightAt = [&](std::int32_t x, std::int32_t y, std::int32_t z) {
      return weightOf(values[OccupancyLeaf::CoordToOffset(Coord(x, y, z))]);
    };
    is_observed = is_observed || (holds_own && weightAt(own[0], own[1], own[2]) > 0);
    for (std::int32_t x = window.first[0]; x <= window.last[0]; ++x) {
      for (std::int32_t y = window.first[1]; y <= window.last[1]; ++y) {
        for (std::int32_t z = window.first[2]; z <= window.last[2]; ++z) {
          const std::uint32_t weight = weightAt(x, y, z);
          most = weight > most ? weight : most;
        }
      }
    }
  }
  weights[n] = is_observed ? most | on_host : 0;
}

}  // namespace

void launchForgetSlots(std::byte* grid, std::uint32_t uppers, cudaStream_t stream) {
  if (uppers == 0) return;
  forgetSlots<<<fusionBlocks(std::uint64_t{uppers} * OccupancyUpper::SIZE), kFusionThreads, 0, stream>>>(grid, uppers);
  checkLaunch("forgetSlots");
}

void launchNoteOnHost(std::byte* grid, DeviceList<GridGrowth::Origin> leaves, cudaStream_t stream) {
  if (leaves.count == 0) return;
  noteOnHost<<<fusionBlocks(leaves.count), kFusionThreads, 0, stream>>>(grid, leaves);
  checkLaunch("noteOnHost");
}

void launchTakeVotes(std::byte* grid, DeviceList<VotesRecord> records, std::uint32_t* votes, std::uint32_t first_slot,
                     cudaStream_t stream) {
  if (records.count == 0) return;
  takeVotes<<<fusionBlocks(std::uint64_t{records.count} * kWarp), kFusionThreads, 0, stream>>>(grid, records, votes,
                                                                                               first_slot);
  checkLaunch("takeVotes");
}

void launchTakeRecords(const ReachView& scan, const CacheView& cache, const SlotsView& slots, std::uint32_t first_slot,
                       DeviceList<LeafRecord> records, const std::uint32_t* missed, std::uint32_t scan_number,
                       cudaStream_t stream) {
  takeRecords<<<fusionBlocks(std::uint64_t{records.count} * kWarp), kFusionThreads, 0, stream>>>(
      scan, cache, slots, first_slot, records, missed, scan_number);
  checkLaunch("takeRecords");
}

void launchKeepReached(const ReachView& scan, const CacheView& cache, std::uint32_t leaves, std::uint32_t scan_number,
                       cudaStream_t stream) {
  if (leaves == 0) return;
  keepReached<<<fusionBlocks(leaves), kFusionThreads, 0, stream>>>(scan, cache, leaves, scan_number);
  checkLaunch("keepReached");
}

void launchCountAges(const CacheView& cache, std::uint32_t scan_number, std::uint32_t* by_age, cudaStream_t stream) {
  if (cache.count == 0) return;
  countAges<<<fusionBlocks(cache.count), kFusionThreads, 0, stream>>>(cache, scan_number, by_age);
  checkLaunch("countAges");
}

void launchEvict(const CacheView& cache, std::uint32_t latest, const SlotsView& slots, std::uint32_t* freed,
                 cudaStream_t stream) {
  if (cache.count == 0) return;
  evict<<<fusionBlocks(cache.count), kFusionThreads, 0, stream>>>(cache, latest, slots, freed);
  checkLaunch("evict");
}

void launchReadWeights(const CacheView& cache, const GridGrowth::Origin* voxels, std::uint32_t count, int reach,
                       std::uint32_t* weights, cudaStream_t stream) {
  if (count == 0) return;
  largestWeights<<<fusionBlocks(count), kFusionThreads, 0, stream>>>(cache, voxels, count, reach, weights);
  checkLaunch("largestWeights");
}

}  // namespace accessvdb::kernels
