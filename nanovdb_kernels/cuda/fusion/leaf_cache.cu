// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Values of leaves on the device: which of them leave when room is short, and what comes back from the host.
#include "cuda/fusion/fusion_views.h"
#include "cuda/fusion/grid_nodes.cuh"
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"

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

/// The weight of one voxel, from the leaf that was asked last if it is in that.
class WeightReader {
 public:
  __device__ explicit WeightReader(const CacheView& cache) : cache_(cache) {}
  /// @return kOwnOnHost, where it is not here
  __device__ std::uint32_t at(const Coord& ijk) {
    const Coord origin(ijk[0] & ~7, ijk[1] & ~7, ijk[2] & ~7);
    if (!any_ || !(origin == origin_)) {
      any_ = true;
      origin_ = origin;
      grid_nodes::Leaf* const leaf = grid_nodes::leafAt(cache_.grid, origin);
      slot_ = leaf == nullptr ? 0 : grid_nodes::slotsOf(reinterpret_cast<std::byte*>(leaf)).values_plus_one;
    }
    if (slot_ == 0) return 0;
    if (slot_ == LeafSlots::kOnHost) return kOwnOnHost;
    return weightOf(cache_.values[std::size_t{512} * (slot_ - 1) + OccupancyLeaf::CoordToOffset(ijk)]);
  }

 private:
  const CacheView& cache_;
  Coord origin_{0, 0, 0};
  bool any_ = false;
  std::uint32_t slot_ = 0;
};

__global__ void largestWeights(CacheView cache, const GridGrowth::Origin* voxels, std::uint32_t count, int reach,
                               std::uint16_t* weights) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= count) return;
  const Coord of = coordOf(voxels[n]);
  WeightReader reader(cache);
  std::uint32_t most = 0, marks = 0;
  const std::uint32_t own = reader.at(of);
  if (own == kOwnOnHost) marks = kOwnOnHost;
  // Leaf by leaf: at most two along each axis, since the reach is below a leaf's edge.
  for (int part = 0; part < 8; ++part) {
    std::int32_t low[3], high[3];
    bool any = true;
    for (int axis = 0; axis < 3; ++axis) {
      const std::int32_t first = of[axis] - reach, last = of[axis] + reach, border = first | 7;
      const bool is_upper = (part >> axis & 1) != 0;
      low[axis] = is_upper ? border + 1 : first;
      high[axis] = is_upper || last < border ? last : border;
      any = any && low[axis] <= high[axis];
    }
    if (!any) continue;
    for (std::int32_t x = low[0]; x <= high[0]; ++x) {
      for (std::int32_t y = low[1]; y <= high[1]; ++y) {
        for (std::int32_t z = low[2]; z <= high[2]; ++z) {
          const std::uint32_t weight = reader.at(Coord(x, y, z));
          if (weight == kOwnOnHost) {
            marks |= kSomeOnHost;
          } else {
            most = weight > most ? weight : most;
          }
        }
      }
    }
  }
  weights[n] = static_cast<std::uint16_t>(own == 0 ? 0 : most | marks);
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
                       std::uint16_t* weights, cudaStream_t stream) {
  if (count == 0) return;
  largestWeights<<<fusionBlocks(count), kFusionThreads, 0, stream>>>(cache, voxels, count, reach, weights);
  checkLaunch("largestWeights");
}

}  // namespace accessvdb::kernels
