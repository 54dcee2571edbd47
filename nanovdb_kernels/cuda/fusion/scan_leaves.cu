// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The leaves that a scan may reach: pairs of leaf and return, sorted by leaf; what the grid has of each, which returns
/// are news, and which slots for values and votes the leaves need.
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_scan.cuh>

#include "cuda/fusion/cub_scratch.cuh"
#include "cuda/fusion/grid_nodes.cuh"
#include "cuda/memory/cuda_check.h"

namespace accessvdb::kernels {
namespace {

using nanovdb::Coord;

/// Whether a line would clear nothing in a leaf. @param bits  [8] of the line
__device__ bool isClear(const ReachView& scan, const std::int32_t* leaf, const std::uint64_t* bits) {
  grid_nodes::Leaf* const found = grid_nodes::leafAt(scan.grid, Coord(leaf[0] * 8, leaf[1] * 8, leaf[2] * 8));
  if (found == nullptr) return false;
  auto* const bytes = reinterpret_cast<std::byte*>(found);
  const std::uint32_t slot = grid_nodes::slotsOf(bytes).values_plus_one;
  if (slot == LeafSlots::kOnHost) return false;
  // Of a leaf without values, what is free for the arm is what was cleared.
  const auto* clear = slot == 0 ? reinterpret_cast<const std::uint64_t*>(bytes + kLeafBitsBytes)
                                : reinterpret_cast<const std::uint64_t*>(scan.cleared + std::size_t{16} * (slot - 1));
  std::uint64_t missing = 0;
  for (int x = 0; x < 8; ++x) missing |= bits[x] & ~clear[x];
  return missing == 0;
}

/// @param visit  (leaf: const std::int32_t* [3], ijk >> 3; part)
template <typename Visit>
__device__ void forEachPair(const ReachView& scan, const ReturnRay& ray, bool is_ball, const RegionSlices& slices,
                            const Visit& visit) {
  if (is_ball) {
    forEachLeafAround(ray, scan.region.ball_radius, [&](const std::int32_t* leaf) { visit(leaf, LeafEntry::kBall); });
    return;
  }
  forEachLeafOfReturn(scan.region, slices, ray, visit);
  if (!scan.region.hasLines()) return;
  forEachLeafOfLine(scan.region, ray, [&](const std::int32_t* leaf, const std::uint64_t* bits) {
    if (!isClear(scan, leaf, bits)) visit(leaf, LeafEntry::kLine);
  });
}

/// The last element is the sum of none: behind it all pairs are counted.
__global__ void countPairs(ReachView scan) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n > scan.ray_count) return;
  std::uint32_t count = 0;
  if (n < scan.ray_count) {
    ReturnRay ray = scan.rays[n];
    const bool is_ball = n >= scan.ray_count - scan.balls;
    const RegionSlices slices(scan.region, ray);
    if (!is_ball) {
      scan.rays[n].cone_x = slices.coneX();
      scan.rays[n].band_x = slices.bandX();
    }
    forEachPair(scan, ray, is_ball, slices, [&](const std::int32_t*, std::uint32_t) { ++count; });
  }
  scan.first_pair[n] = count;
}

__global__ void answer(FusionCounters* counters) { counters->pairs = 1; }

__global__ void notePairs(ReachView scan) { scan.counters->pairs = scan.first_pair[scan.ray_count]; }

__global__ void writePairs(ReachView scan) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= scan.ray_count) return;
  const ReturnRay ray = scan.rays[n];
  const RegionSlices slices(scan.region, ray);
  std::uint32_t at = scan.first_pair[n];
  forEachPair(scan, ray, n >= scan.ray_count - scan.balls, slices, [&](const std::int32_t* leaf, std::uint32_t part) {
    scan.keys[at] = leafKeyOf(scan.key_space, leaf);
    scan.entries[at++] = {n << 2 | part};
  });
}

__global__ void markFirsts(ReachView scan, std::uint32_t pairs) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n < pairs) scan.leaf_of_pair[n] = n == 0 || scan.sorted_keys[n] != scan.sorted_keys[n - 1] ? 1 : 0;
}

__global__ void beginLeaves(ReachView scan, std::uint32_t pairs) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= pairs) return;
  const std::uint32_t leaf = scan.leaf_of_pair[n] - 1;
  if (n == 0 || scan.leaf_of_pair[n - 1] - 1 != leaf) {
    scan.leaf_keys[leaf] = scan.sorted_keys[n];
    scan.leaves[leaf].begin = n;
    scan.parts[leaf] = 0;
  }
  if (n + 1 == pairs || scan.leaf_of_pair[n + 1] - 1 != leaf) scan.leaves[leaf].end = n + 1;
  if (n + 1 == pairs) scan.counters->leaves = leaf + 1;
}

/// Adds up what the threads of a block say. All of them call it.
__device__ void addOfBlock(std::uint32_t* counter, bool counts) {
  const int sum = __syncthreads_count(counts);
  if (threadIdx.x == 0 && sum > 0) atomicAdd(counter, static_cast<std::uint32_t>(sum));
}

/// What the grid has of each leaf.
__global__ void findLeaves(ReachView scan) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x, count = scan.counters->leaves;
  if (blockIdx.x * kFusionThreads >= count) return;  // the whole block
  bool is_missing = false, lacks_lower = false, lacks_upper = false, is_heavy = false;
  if (n < count) {
    const std::uint64_t key = scan.leaf_keys[n];
    const Coord ijk = originOf(scan.key_space, key);
    grid_nodes::Upper* const upper = grid_nodes::upperAt(scan.grid, ijk);
    grid_nodes::Lower* const lower = grid_nodes::lowerIn(upper, ijk);
    grid_nodes::Leaf* const leaf = grid_nodes::leafIn(lower, ijk);
    FusedLeaf& fused = scan.leaves[n];
    for (int axis = 0; axis < 3; ++axis) fused.origin_ijk[axis] = ijk[axis];
    fused.facts = fused.values = fused.votes = FusedLeaf::kNone;
    if (leaf != nullptr) {
      fused.facts = grid_nodes::unitOf(scan.grid, leaf);
      const LeafSlots slots = grid_nodes::slotsOf(reinterpret_cast<std::byte*>(leaf));
      if (slots.values_plus_one == LeafSlots::kOnHost) {
        scan.missed[atomicAdd(&scan.counters->missed, 1u)] = n;
      } else if (slots.values_plus_one != 0) {
        fused.values = slots.values_plus_one - 1;
      }
      if (slots.votes_plus_one != 0) fused.votes = slots.votes_plus_one - 1;
    }
    is_missing = leaf == nullptr;
    is_heavy = fused.end - fused.begin > kMostLightEntries;
    const auto isFirstOf = [&](int shift) { return n == 0 || scan.leaf_keys[n - 1] >> shift != key >> shift; };
    lacks_lower = lower == nullptr && isFirstOf(LeafKeys::kLowerShift);
    lacks_upper = upper == nullptr && isFirstOf(LeafKeys::kUpperShift);
  }
  addOfBlock(&scan.counters->missing_leaves, is_missing);
  addOfBlock(&scan.counters->missing_lowers, lacks_lower);
  addOfBlock(&scan.counters->missing_uppers, lacks_upper);
  addOfBlock(&scan.counters->heavy, is_heavy);
}

/// Which returns are news, by what the map holds in their own voxel.
__global__ void findNews(ReachView scan) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= scan.ray_count - scan.balls) return;
  ReturnRay& ray = scan.rays[n];
  const Coord ijk(ray.base_ijk[0], ray.base_ijk[1], ray.base_ijk[2]);
  grid_nodes::Leaf* const leaf = grid_nodes::leafAt(scan.grid, ijk);
  std::uint32_t news = 0;
  if (leaf != nullptr) {
    const std::uint32_t slot = grid_nodes::slotsOf(reinterpret_cast<std::byte*>(leaf)).values_plus_one;
    if (slot != 0 && slot != LeafSlots::kOnHost) {
      const std::uint32_t voxel = OccupancyLeaf::CoordToOffset(ijk);
      news = scan.news.isNews(scan.values[std::size_t{512} * (slot - 1) + voxel]) ? 1 : 0;
    }
  }
  ray.news = news;
}

/// Which leaves may get values, or votes.
__global__ void noteParts(ReachView scan, std::uint32_t pairs) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= pairs) return;
  const LeafEntry entry = scan.sorted_entries[n];
  if (!entry.cone()) return;
  const bool is_news = scan.votes && scan.rays[entry.index()].news != 0;
  const std::uint32_t parts = ReachView::kHasCone | (is_news ? ReachView::kHasNews : 0);
  std::uint32_t& of_leaf = scan.parts[scan.leaf_of_pair[n] - 1];
  if ((of_leaf & parts) != parts) atomicOr(&of_leaf, parts);
}

/// Has a term for each pair, which are at least as many as leaves; those behind the leaves are zero.
__global__ void noteNeeds(ReachView scan, std::uint32_t pairs) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n > pairs) return;
  std::uint64_t needs = 0;
  if (n < scan.counters->leaves) {
    const FusedLeaf& leaf = scan.leaves[n];
    const std::uint32_t parts = scan.parts[n];
    if ((parts & ReachView::kHasCone) != 0 && leaf.values == FusedLeaf::kNone) needs |= 1;
    if ((parts & ReachView::kHasNews) != 0 && leaf.votes == FusedLeaf::kNone) needs |= std::uint64_t{1} << 32;
  }
  scan.needs[n] = needs;
}

__global__ void sumNeeds(ReachView scan, std::uint32_t pairs) {
  const std::uint64_t all = scan.needs[pairs];
  scan.counters->value_needs = static_cast<std::uint32_t>(all);
  scan.counters->vote_needs = static_cast<std::uint32_t>(all >> 32);
}

__global__ void assignSlots(ReachView scan, SlotsView values, SlotsView votes, std::uint32_t leaves) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= leaves) return;
  FusedLeaf& leaf = scan.leaves[n];
  const std::uint64_t before = scan.needs[n], need = scan.needs[n + 1] - before;
  if ((need & 1) != 0) leaf.values = FusedLeaf::kFresh | nthSlot(values, static_cast<std::uint32_t>(before));
  if (need >> 32 != 0) leaf.votes = FusedLeaf::kFresh | nthSlot(votes, static_cast<std::uint32_t>(before >> 32));
  // Twice as many returns, the next class: those that take longest come first.
  const std::uint32_t entries = leaf.end - leaf.begin;
  scan.classes[n] = static_cast<std::uint8_t>(32 - __clz(static_cast<int>(entries - 1)));
  scan.order[n] = n;
}
static_assert((kMostLightEntries & (kMostLightEntries - 1)) == 0, "a class has no heavy and light leaves");

__global__ void listMissed(ReachView scan, std::uint32_t missed, GridGrowth::Origin* origins) {
  const std::uint32_t n = blockIdx.x * kFusionThreads + threadIdx.x;
  if (n >= missed) return;
  auto* const to = reinterpret_cast<std::int32_t*>(origins + n);
  for (int axis = 0; axis < 3; ++axis) to[axis] = scan.leaves[scan.missed[n]].origin_ijk[axis];
}

}  // namespace

void launchAnswer(FusionCounters* counters, cudaStream_t stream) {
  answer<<<1, 1, 0, stream>>>(counters);
  checkLaunch("answer");
}

void launchListMissed(const ReachView& scan, std::uint32_t missed, GridGrowth::Origin* origins, cudaStream_t stream) {
  listMissed<<<fusionBlocks(missed), kFusionThreads, 0, stream>>>(scan, missed, origins);
  checkLaunch("listMissed");
}

void launchCountPairs(const ReachView& scan, CubScratch& scratch, cudaStream_t stream) {
  countPairs<<<fusionBlocks(std::uint64_t{scan.ray_count} + 1), kFusionThreads, 0, stream>>>(scan);
  checkLaunch("countPairs");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceScan::ExclusiveSum(memory, bytes, scan.first_pair, scan.first_pair,
                                                      static_cast<int>(scan.ray_count + 1), stream);
  });
  notePairs<<<1, 1, 0, stream>>>(scan);
  checkLaunch("notePairs");
}

void launchListLeaves(const ReachView& scan, std::uint32_t pairs, int key_bits, CubScratch& scratch,
                      cudaStream_t stream) {
  writePairs<<<fusionBlocks(scan.ray_count), kFusionThreads, 0, stream>>>(scan);
  checkLaunch("writePairs");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceRadixSort::SortPairs(
        memory, bytes, scan.keys, scan.sorted_keys, reinterpret_cast<const std::uint32_t*>(scan.entries),
        reinterpret_cast<std::uint32_t*>(scan.sorted_entries), static_cast<int>(pairs), 0, key_bits, stream);
  });
  markFirsts<<<fusionBlocks(pairs), kFusionThreads, 0, stream>>>(scan, pairs);
  checkLaunch("markFirsts");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceScan::InclusiveSum(memory, bytes, scan.leaf_of_pair, scan.leaf_of_pair,
                                                      static_cast<int>(pairs), stream);
  });
  beginLeaves<<<fusionBlocks(pairs), kFusionThreads, 0, stream>>>(scan, pairs);
  checkLaunch("beginLeaves");
}

void launchFindLeaves(const ReachView& scan, std::uint32_t pairs, cudaStream_t stream) {
  findLeaves<<<fusionBlocks(pairs), kFusionThreads, 0, stream>>>(scan);
  checkLaunch("findLeaves");
}

void launchFindNeeds(const ReachView& scan, std::uint32_t pairs, CubScratch& scratch, cudaStream_t stream) {
  if (scan.votes) {
    findNews<<<fusionBlocks(scan.ray_count), kFusionThreads, 0, stream>>>(scan);
    checkLaunch("findNews");
  }
  noteParts<<<fusionBlocks(pairs), kFusionThreads, 0, stream>>>(scan, pairs);
  checkLaunch("noteParts");
  noteNeeds<<<fusionBlocks(std::uint64_t{pairs} + 1), kFusionThreads, 0, stream>>>(scan, pairs);
  checkLaunch("noteNeeds");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceScan::ExclusiveSum(memory, bytes, scan.needs, scan.needs,
                                                      static_cast<int>(pairs + 1), stream);
  });
  sumNeeds<<<1, 1, 0, stream>>>(scan, pairs);
  checkLaunch("sumNeeds");
}

void launchAssignSlots(const ReachView& scan, std::uint32_t leaves, const SlotsView& values, const SlotsView& votes,
                       CubScratch& scratch, cudaStream_t stream) {
  assignSlots<<<fusionBlocks(leaves), kFusionThreads, 0, stream>>>(scan, values, votes, leaves);
  checkLaunch("assignSlots");
  withScratch(scratch, [&](void* memory, std::size_t& bytes) {
    return CUB_NS_QUALIFIER::DeviceRadixSort::SortPairsDescending(memory, bytes, scan.classes, scan.sorted_classes,
                                                                  scan.order, scan.sorted_order,
                                                                  static_cast<int>(leaves), 0, 6, stream);
  });
}

}  // namespace accessvdb::kernels
