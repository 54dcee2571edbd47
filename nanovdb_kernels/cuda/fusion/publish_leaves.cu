// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a scan did to its leaves, in the grid: new leaves with the nodes above them, in the order of their keys, bits
/// that flipped, and where values and votes are.
#include <cub/device/device_scan.cuh>

#include "cuda/fusion/cub_scratch.cuh"
#include "cuda/fusion/grid_nodes.cuh"
#include "cuda/search/warp.cuh"
#include "hostdev/flips_hash.h"
#include "hostdev/freed_corridors.h"

namespace accessvdb::kernels {
namespace {

using nanovdb::Coord;

constexpr unsigned kLanesPerLeaf = 16;  ///< one for each word of bits

__device__ GrowthCounts addedBy(const FusionCounters& counters) {
  return {counters.new_uppers, counters.new_lowers, counters.new_leaves};
}

struct AddFound {
  __device__ FoundLeaf operator()(const FoundLeaf& a, const FoundLeaf& b) const {
    return {a.added + b.added, a.freed_values + b.freed_values, a.freed_votes + b.freed_votes, a.flipped + b.flipped,
            a.flipped_collisions + b.flipped_collisions};
  }
};

__device__ void addOfWarp(std::uint64_t* counter, std::uint32_t value) {
  const std::uint32_t sum = __reduce_add_sync(kAllLanes, value);
  if (threadIdx.x % kWarp == 0 && sum > 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(counter), static_cast<unsigned long long>(sum));
  }
}
__device__ void addOfWarp(std::uint32_t* counter, bool counts) {
  const unsigned all = __ballot_sync(kAllLanes, counts);
  if (threadIdx.x % kWarp == 0 && all != 0) atomicAdd(counter, static_cast<std::uint32_t>(__popc(all)));
}

__global__ void noteFound(ReachView scan, FusionView fused, GrowthView growth) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  FusedOutcome outcome = {};
  FoundLeaf found = {};
  if (n < fused.count) {
    outcome = fused.outcomes[n];
    const FusedLeaf& leaf = fused.leaves[n];
    const bool has_fresh = leaf.values != FusedLeaf::kNone && (leaf.values & FusedLeaf::kFresh) != 0;
    const bool is_reached = (outcome.flags & FusedOutcome::kReached) != 0;
    const bool is_fresh_vote = leaf.votes != FusedLeaf::kNone && (leaf.votes & FusedLeaf::kFresh) != 0;
    found.added = is_reached && leaf.facts == FusedLeaf::kNone ? 1 : 0;
    found.freed_values = has_fresh && (outcome.flags & FusedOutcome::kSampled) == 0 ? 1 : 0;
    // A leaf that was not reached keeps its votes.
    found.freed_votes = leaf.votes != FusedLeaf::kNone && (is_reached || is_fresh_vote) &&
                                (outcome.flags & FusedOutcome::kHasVotes) == 0
                            ? 1
                            : 0;
  }
  found.flipped = (outcome.flags & FusedOutcome::kFlipped) != 0 ? 1 : 0;
  found.flipped_collisions = outcome.flipped_collisions;
  if (n <= fused.count) growth.found[n] = found;
  FusionCounters& counters = *scan.counters;
  addOfWarp(&counters.touched_leaves, (outcome.flags & FusedOutcome::kReached) != 0);
  addOfWarp(&counters.changed_leaves, (outcome.flags & FusedOutcome::kFlipped) != 0);
  addOfWarp(&counters.distance_updates, outcome.distance_updates);
  addOfWarp(&counters.cleared_updates, outcome.cleared_updates);
  addOfWarp(&counters.newly_observed, outcome.newly_observed);
  addOfWarp(&counters.flipped_voxels, outcome.flipped_voxels);
}

/// Lists new leaves, and slots that are free again.
__global__ void listFound(ReachView scan, FusionView fused, GrowthView growth, SlotsView values, SlotsView votes) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= fused.count) return;
  const FoundLeaf &before = growth.found[n], &behind = growth.found[n + 1];
  const FusedLeaf& leaf = fused.leaves[n];
  if (behind.added != before.added) growth.new_leaves[before.added] = n;
  if (behind.freed_values != before.freed_values) {
    values.free[values.free_count + before.freed_values] = leaf.values & ~FusedLeaf::kFresh;
  }
  if (behind.freed_votes != before.freed_votes) {
    votes.free[votes.free_count + before.freed_votes] = leaf.votes & ~FusedLeaf::kFresh;
  }
  if (n + 1 != fused.count) return;
  scan.counters->new_leaves = behind.added;
  scan.counters->freed_values = behind.freed_values;
  scan.counters->freed_votes = behind.freed_votes;
  scan.counters->flipped_collisions = behind.flipped_collisions;
}

/// Marks the new leaves that are the first of a lower node that is not there.
__global__ void markLowers(ReachView scan, GrowthView growth, std::uint32_t most) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n > most) return;
  std::uint32_t first = 0;
  if (n < scan.counters->new_leaves) {
    const std::uint64_t key = scan.leaf_keys[growth.new_leaves[n]];
    if (n == 0 || scan.leaf_keys[growth.new_leaves[n - 1]] >> LeafKeys::kLowerShift != key >> LeafKeys::kLowerShift) {
      const Coord ijk = originOf(scan.key_space, key);
      first = grid_nodes::lowerIn(grid_nodes::upperAt(scan.grid, ijk), ijk) == nullptr ? 1 : 0;
    }
  }
  growth.firsts[n] = first;
}

__global__ void listLowers(ReachView scan, GrowthView growth, std::uint32_t most) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= most) return;
  const std::uint32_t before = growth.firsts[n], behind = growth.firsts[n + 1];
  if (before != behind) growth.new_lowers[before] = scan.leaf_keys[growth.new_leaves[n]];
  if (n + 1 == most) scan.counters->new_lowers = behind;
}

__device__ void writeOrigin(const Coord& ijk, GridGrowth::Origin& origin) {
  auto* const to = reinterpret_cast<std::int32_t*>(&origin);
  for (int axis = 0; axis < 3; ++axis) to[axis] = ijk[axis];
}

/// One block. Upper nodes are few: each thread looks for those among its lower nodes' that are not there.
__global__ void addUppers(ReachView scan, GrowthView growth) {
  FusionCounters& counters = *scan.counters;
  if (threadIdx.x == 0) {
    std::uint32_t uppers = 0;
    for (std::uint32_t n = 0; n < counters.new_lowers; ++n) {
      const std::uint64_t key = growth.new_lowers[n];
      if (n > 0 && growth.new_lowers[n - 1] >> LeafKeys::kUpperShift == key >> LeafKeys::kUpperShift) continue;
      if (grid_nodes::upperAt(scan.grid, originOf(scan.key_space, key)) == nullptr) growth.new_uppers[uppers++] = key;
    }
    counters.new_uppers = uppers;
  }
  __syncthreads();
  grid_nodes::Root* const root = grid_nodes::rootOf(scan.grid);
  for (std::uint32_t n = threadIdx.x; n < counters.new_uppers; n += blockDim.x) {
    const Coord ijk = originOf(scan.key_space, growth.new_uppers[n]);
    const Coord origin(ijk[0] & ~4095, ijk[1] & ~4095, ijk[2] & ~4095);
    auto* const upper = reinterpret_cast<grid_nodes::Upper*>(scan.grid + newUpperOffset(growth.space, n));
    upper->mBBox[0] = upper->mBBox[1] = origin;
    grid_nodes::Root::Tile& tile = grid_nodes::tilesOf(root)[growth.space.uppers + n];
    tile.key = grid_nodes::Root::CoordToKey(origin);
    tile.child = reinterpret_cast<std::byte*>(upper) - reinterpret_cast<std::byte*>(root);
    writeOrigin(origin, growth.origins[n]);
  }
  if (threadIdx.x != 0) return;
  root->mTableSize = growth.space.uppers + counters.new_uppers;
  auto* const tree = reinterpret_cast<nanovdb::NanoTree<bool>::DataType*>(scan.grid + grid_nodes::kTreeBytes);
  tree->mNodeCount[0] = growth.space.leaves + counters.new_leaves;
  tree->mNodeCount[1] = growth.space.lowers + counters.new_lowers;
  tree->mNodeCount[2] = growth.space.uppers + counters.new_uppers;
}

__global__ void addLowers(ReachView scan, GrowthView growth) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= scan.counters->new_lowers) return;
  const Coord ijk = originOf(scan.key_space, growth.new_lowers[n]);
  const Coord origin(ijk[0] & ~127, ijk[1] & ~127, ijk[2] & ~127);
  auto* const lower =
      reinterpret_cast<grid_nodes::Lower*>(scan.grid + newLowerOffset(growth.space, addedBy(*scan.counters), n));
  lower->mBBox[0] = lower->mBBox[1] = origin;
  grid_nodes::link(grid_nodes::upperAt(scan.grid, origin), OccupancyUpper::CoordToOffset(origin), lower);
  writeOrigin(origin, growth.origins[scan.counters->new_uppers + n]);
}

__global__ void addLeaves(ReachView scan, GrowthView growth) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= scan.counters->new_leaves) return;
  const std::uint32_t number = growth.new_leaves[n];
  const Coord origin = originOf(scan.key_space, scan.leaf_keys[number]);
  auto* const leaf = reinterpret_cast<grid_nodes::Leaf*>(
      scan.grid + newLeafOffset(growth.space, addedBy(*scan.counters), growth.space.leaves + n));
  leaf->mBBoxMin = origin;
  grid_nodes::Lower* const lower = grid_nodes::lowerIn(grid_nodes::upperAt(scan.grid, origin), origin);
  grid_nodes::link(lower, OccupancyLower::CoordToOffset(origin), leaf);
  scan.leaves[number].facts = grid_nodes::unitOf(scan.grid, leaf);
  writeOrigin(origin, growth.origins[scan.counters->new_uppers + scan.counters->new_lowers + n]);
}

/// Where a leaf's values and votes are from now on. @param leaf  in the grid
__device__ void noteSlots(std::byte* leaf, const FusedLeaf& fused, const FusedOutcome& outcome, const CacheView& cache,
                          std::uint32_t scan_number) {
  LeafSlots& slots = grid_nodes::slotsOf(leaf);
  if (fused.values != FusedLeaf::kNone) {
    const std::uint32_t slot = fused.values & ~FusedLeaf::kFresh;
    const bool has_values = (fused.values & FusedLeaf::kFresh) == 0 || (outcome.flags & FusedOutcome::kSampled) != 0;
    if (has_values) {
      slots.values_plus_one = slot + 1;
      cache.owner[slot] = fused.facts;
      cache.stamp[slot] = scan_number;
    }
  }
  if (fused.votes != FusedLeaf::kNone) {
    const bool has_votes = (outcome.flags & FusedOutcome::kHasVotes) != 0;
    slots.votes_plus_one = has_votes ? (fused.votes & ~FusedLeaf::kFresh) + 1 : 0;
  }
}

/// Four words of flips, in the order of a LeafPatch.
__device__ const std::uint64_t* flipsOf(const FusedFlips& flips, unsigned set) {
  const std::uint32_t* const sets[4] = {flips.arm_free_on, flips.collides_on, flips.arm_free_off, flips.collides_off};
  return reinterpret_cast<const std::uint64_t*>(sets[set]);
}

/// Sixteen lanes for each leaf.
__global__ void switchBits(ReachView scan, FusionView fused, CacheView cache, std::uint32_t scan_number) {
  const std::uint64_t thread = std::uint64_t{blockIdx.x} * kFusionThreads + threadIdx.x;
  const auto n = static_cast<std::uint32_t>(thread / kLanesPerLeaf);
  const unsigned word = static_cast<unsigned>(thread % kLanesPerLeaf);
  FusedOutcome outcome = {};
  FusedLeaf leaf = {};
  if (n < fused.count) {
    outcome.flags = fused.outcomes[n].flags;
    leaf = fused.leaves[n];
  }
  const bool is_reached = (outcome.flags & FusedOutcome::kReached) != 0;
  const bool is_flipped = (outcome.flags & FusedOutcome::kFlipped) != 0;
  std::byte* const bytes = is_reached ? grid_nodes::leafAtUnit(scan.grid, leaf.facts) : nullptr;
  if (is_reached && word == 0) noteSlots(bytes, leaf, outcome, cache, scan_number);
  if (__ballot_sync(kAllLanes, is_flipped) == 0) return;
  std::uint64_t after = 0, hash = 0;
  bool changes_collisions = false;
  auto* const bits = reinterpret_cast<std::uint64_t*>(bytes + kLeafBitsBytes);
  if (is_flipped) {
    const FusedFlips& flips = fused.flips[n];
    const bool collides = word >= 8;
    const unsigned set = word / 8;
    const std::uint64_t on = flipsOf(flips, set)[word % 8], off = flipsOf(flips, 2 + set)[word % 8];
    const std::uint64_t before = bits[word], key = flipsKey(leaf.origin_ijk[0], leaf.origin_ijk[1], leaf.origin_ijk[2]);
    hash = flipsHashOfWord(on, word, key) + flipsHashOfWord(off, word + kLanesPerLeaf, key);
    after = switched(before, on, off);
    if (after != before) bits[word] = after;
    changes_collisions = collides && after != before;
  }
  const unsigned half = threadIdx.x % kWarp / kLanesPerLeaf * kLanesPerLeaf;
  const bool counts_cells = (__ballot_sync(kAllLanes, changes_collisions) >> half & 0xffffu) != 0;
  std::uint64_t words[8];
#pragma unroll
  for (unsigned x = 0; x < 8; ++x) words[x] = __shfl_sync(kAllLanes, after, static_cast<int>(half + 8 + x));
  if (counts_cells && word == 0) bits[kLeafWords] = countCells(words);
  for (unsigned step = kWarp / 2; step > 0; step /= 2) hash += __shfl_down_sync(kAllLanes, hash, step);
  if (threadIdx.x % kWarp == 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(&scan.counters->flips_hash), static_cast<unsigned long long>(hash));
  }
}

/// Eight threads for each leaf: one for each x.
__global__ void listFlips(FusionView fused, const FoundLeaf* found, LeafFlips* leaves, std::uint16_t* voxels,
                          std::uint32_t first_voxel) {
  const std::uint64_t thread = std::uint64_t{blockIdx.x} * kFusionThreads + threadIdx.x;
  const auto n = static_cast<std::uint32_t>(thread / 8);
  const auto x = static_cast<unsigned>(thread % 8);
  const bool is_flipped = n < fused.count && found[n + 1].flipped != found[n].flipped;
  if (__ballot_sync(kAllLanes, is_flipped) == 0) return;
  std::uint64_t on = 0, off = 0;
  if (is_flipped) {
    on = flipsOf(fused.flips[n], 1)[x];
    off = flipsOf(fused.flips[n], 3)[x];
  }
  const auto own = static_cast<std::uint32_t>(__popcll(on) + __popcll(off));
  std::uint32_t up_to = own;
  for (unsigned step = 1; step < 8; step *= 2) {
    const std::uint32_t below = __shfl_up_sync(kAllLanes, up_to, step, 8);
    if (x >= step) up_to += below;
  }
  if (!is_flipped) return;
  const std::uint32_t first = first_voxel + found[n].flipped_collisions;
  std::uint16_t* to = voxels + first + up_to - own;
  for (const bool collides : {true, false}) {
    for (std::uint64_t left = collides ? on : off; left != 0; left &= left - 1) {
      *to++ = flipped_voxel::codeOf(static_cast<int>(64 * x) + __ffsll(static_cast<long long>(left)) - 1, collides);
    }
  }
  if (x != 0) return;
  const FusedFlips& flips = fused.flips[n];
  LeafFlips leaf;
  std::uint16_t kinds = 0;
  const unsigned of_kind[4] = {1, 3, 0, 2};  // LeafFlips::kinds
  for (unsigned kind = 0; kind < 4; ++kind) {
    const std::uint64_t* const words = flipsOf(flips, of_kind[kind]);
    std::uint64_t any = 0;
    for (int w = 0; w < 8; ++w) any |= words[w];
    if (any != 0) kinds = static_cast<std::uint16_t>(kinds | 1u << kind);
  }
  const ColumnsForArm freed = columnsForArm(flipsOf(flips, 0)), blocked = columnsForArm(flipsOf(flips, 2));
  for (int axis = 0; axis < 3; ++axis) leaf.leaf[axis] = fused.leaves[n].origin_ijk[axis] >> 3;
  leaf.kinds = kinds;
  leaf.freed_heights = static_cast<std::uint8_t>(freed.heights);
  leaf.blocked_heights = static_cast<std::uint8_t>(blocked.heights);
  leaf.freed = countCells(flipsOf(flips, 3));
  leaf.freed_columns = freed.columns;
  leaf.blocked_columns = blocked.columns;
  leaf.first_voxel = first;
  leaf.voxels = found[n + 1].flipped_collisions - found[n].flipped_collisions;
  leaves[found[n].flipped] = leaf;
}

}  // namespace

void launchListFlips(const FusionView& fused, const FoundLeaf* found, LeafFlips* leaves, std::uint16_t* voxels,
                     std::uint32_t first_voxel, cudaStream_t stream) {
  listFlips<<<fusionBlocks(std::uint64_t{fused.count} * 8), kFusionThreads, 0, stream>>>(fused, found, leaves, voxels,
                                                                                         first_voxel);
  checkLaunch("listFlips");
}

void launchPublishLeaves(const ReachView& scan, const FusionView& fused, const GrowthView& growth,
                         const FusionCounters& most, const SlotsView& values, const SlotsView& votes,
                         const CacheView& cache, std::uint32_t scan_number, CubScratch& scratch, cudaStream_t stream) {
  noteFound<<<fusionBlocks(std::uint64_t{fused.count} + 1), kFusionThreads, 0, stream>>>(scan, fused, growth);
  checkLaunch("noteFound");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceScan::ExclusiveScan(memory, bytes, growth.found, growth.found, AddFound{},
                                                       FoundLeaf{}, static_cast<int>(fused.count + 1), stream);
  });
  listFound<<<fusionBlocks(fused.count), kFusionThreads, 0, stream>>>(scan, fused, growth, values, votes);
  checkLaunch("listFound");
  if (most.missing_leaves > 0) {
    if (most.missing_lowers > 0) {
      markLowers<<<fusionBlocks(std::uint64_t{most.missing_leaves} + 1), kFusionThreads, 0, stream>>>(
          scan, growth, most.missing_leaves);
      checkLaunch("markLowers");
      withScratch(scratch, [&](void* memory, std::size_t& bytes) {
        return CUB_NS_QUALIFIER::DeviceScan::ExclusiveSum(memory, bytes, growth.firsts, growth.firsts,
                                                          static_cast<int>(most.missing_leaves + 1), stream);
      });
      listLowers<<<fusionBlocks(most.missing_leaves), kFusionThreads, 0, stream>>>(scan, growth, most.missing_leaves);
      checkLaunch("listLowers");
    }
    addUppers<<<1, kFusionThreads, 0, stream>>>(scan, growth);
    checkLaunch("addUppers");
    if (most.missing_lowers > 0) {
      addLowers<<<fusionBlocks(most.missing_lowers), kFusionThreads, 0, stream>>>(scan, growth);
      checkLaunch("addLowers");
    }
    addLeaves<<<fusionBlocks(most.missing_leaves), kFusionThreads, 0, stream>>>(scan, growth);
    checkLaunch("addLeaves");
  }
  switchBits<<<fusionBlocks(std::uint64_t{fused.count} * kLanesPerLeaf), kFusionThreads, 0, stream>>>(
      scan, fused, cache, scan_number);
  checkLaunch("switchBits");
}

}  // namespace accessvdb::kernels
