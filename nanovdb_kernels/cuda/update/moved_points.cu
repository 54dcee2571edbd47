// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Finds neighbourhoods that the touched points may have changed: a touched point matters to another only if its old or
/// new mean lies no farther away than the k-th neighbour did, or if the two compete (as in src/update/moved_points.h).
/// So it always finds itself if it had neighbours. Finding too many costs time but changes nothing.
#include <cfloat>

#include "cuda/memory/cuda_check.h"
#include "cuda/update/near_blocks.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/box_in_leaf.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4;
/// Places that a warp keeps; if more lie near a block, all of its points count as moved.
constexpr unsigned kMostPlaces = 512;

/// One warp per touched block: finds the blocks with a point that it may matter to.
/// @tparam kCompete  whether points compete
template <bool kCompete>
__global__ void reachBlocks(PointsView points, MovedView moved, CompetitionView competition, float most_reach_voxels) {
  const unsigned n = (blockIdx.x * blockDim.x + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= moved.counters->touched_blocks) return;
  const std::int32_t* leaf = points.index.leaf + 3 * static_cast<std::size_t>(moved.places.touched_blocks[n]);
  forEachNear(points.index, leaf, most_reach_voxels, lane, [&](std::uint32_t block, float squared_gap) {
    if (block == kNoIndex) return;
    const float reach_m = points.index.reach_m[block];
    if (reach_m < 0) return;
    float reach_voxels = blockReachVoxels(points, reach_m);
    if constexpr (kCompete) reach_voxels = fmaxf(reach_voxels, competition.reach_voxels);
    if (squared_gap > reach_voxels * reach_voxels) return;
    const std::uint32_t bit = 1u << (block & 31);
    if ((atomicOr(moved.places.reached_bits + (block >> 5), bit) & bit) != 0) return;
    moved.places.reached_blocks[atomicAdd(&moved.counters->reached_blocks, 1u)] = block;
  });
}

/// Appends points of a block to the list, next to each other. All lanes call it.
/// @param ids  of the block  @param mine  those of ids[32 * lane ...]
__device__ void listMoved(const MovedView& moved, const std::uint32_t* ids, unsigned mine, unsigned lane) {
  static_assert(kMostInBlock <= kWarp * kWarp);
  const std::uint32_t count = __reduce_add_sync(kAllLanes, static_cast<unsigned>(__popc(mine)));
  if (count == 0) return;
  std::uint32_t at = 0;
  if (lane == 0) {
    at = atomicAdd(&moved.counters->moved, count);
    moved.blocks[atomicAdd(&moved.counters->moved_blocks, 1u)] = {at, count};
  }
  at = __shfl_sync(kAllLanes, at, 0);
  for (unsigned turns = __ballot_sync(kAllLanes, mine != 0); turns != 0; turns &= turns - 1) {
    const int turn = __ffs(static_cast<int>(turns)) - 1;
    const unsigned all = __shfl_sync(kAllLanes, mine, turn);
    if ((all >> lane & 1u) != 0) {
      moved.ids[at + __popc(all & ((1u << lane) - 1u))] = ids[static_cast<unsigned>(turn) * kWarp + lane];
    }
    at += __popc(all);
  }
}

/// Whether a point competes with any that was touched: there is one in a voxel of its cell within the window.
__device__ bool competesWithTouched(const PointsView& points, const CompetitionView& competition, std::uint32_t id) {
  const int axis = competingAxis(points.points.normal_L + 3 * static_cast<std::size_t>(id));
  if (axis < 0) return false;
  const float* p = points.points.position_L + 3 * static_cast<std::size_t>(id);
  const Coord voxel = voxelOf(p[0], p[1], p[2], competition.inverse_voxel_size);
  const std::int32_t at[3] = {voxel[0], voxel[1], voxel[2]};
  const CompetingVoxels box(competition.choice, at, axis);
  std::int32_t leaf[3];
  for (leaf[0] = box.low[0] >> 3; leaf[0] <= box.high[0] >> 3; ++leaf[0]) {
    for (leaf[1] = box.low[1] >> 3; leaf[1] <= box.high[1] >> 3; ++leaf[1]) {
      for (leaf[2] = box.low[2] >> 3; leaf[2] <= box.high[2] >> 3; ++leaf[2]) {
        const std::uint32_t block = points.index.find(leaf[0], leaf[1], leaf[2]);
        if (block == kNoIndex) continue;
        if (BoxInLeaf(leaf, box.low, box.high).hasAnyOf(competition.touched_voxels + 8 * std::size_t{block}))
          return true;
      }
    }
  }
  return false;
}

/// One warp per reached block.
template <bool kCompete>
__global__ void findMoved(PointsView points, MovedView moved, CompetitionView competition) {
  __shared__ float all_places[kWarps][kMostPlaces][3];
  __shared__ std::uint32_t all_counts[kWarps];
  const unsigned warp = threadIdx.x / kWarp, lane = threadIdx.x % kWarp;
  float(*const places)[3] = all_places[warp];
  std::uint32_t& count = all_counts[warp];
  const std::uint32_t reached = moved.counters->reached_blocks;
  for (std::uint32_t n = blockIdx.x * kWarps + warp; n < reached; n += gridDim.x * kWarps) {
    const std::uint32_t block = moved.places.reached_blocks[n];
    const std::int32_t* leaf = points.index.leaf + 3 * static_cast<std::size_t>(block);
    const float reach_voxels = blockReachVoxels(points, points.index.reach_m[block]);
    if (lane == 0) count = 0;
    __syncwarp();
    const auto add = [&](const float* p) {
      const std::uint32_t at = atomicAdd(&count, 1u);
      if (at >= kMostPlaces) return;
      for (int axis = 0; axis < 3; ++axis) places[at][axis] = p[axis];
    };
    forEachNear(points.index, leaf, reach_voxels, lane, [&](std::uint32_t near, float) {
      if (near == kNoIndex) return;
      for (std::uint32_t at = moved.places.head[near]; at != kNoIndex; at = moved.places.places[at].next) {
        const TouchedPlace& place = moved.places.places[at];
        add(place.now_L);
        if (!isnan(place.before_L[0])) add(place.before_L);
      }
    });
    __syncwarp();
    const std::uint32_t there = count;
    const std::uint32_t first = points.index.first[block], count_here = points.index.count[block];
    float most_m = -1;
    unsigned all_moved = 0;  // of the 32 points that begin at 32 * lane
    for (std::uint32_t from = 0; from < count_here; from += kWarp) {
      bool is_moved = false;
      if (from + lane < count_here) {
        const std::uint32_t id = points.index.ids[first + from + lane];
        const float reach_m = points.state.reach_m[id];
        most_m = fmaxf(most_m, reach_m);
        const float* mean = points.meanOf(id);
        const float bound = reach_m * reach_m * kReachSlack;
        is_moved = there > kMostPlaces;
        for (std::uint32_t p = 0; p < there && !is_moved; ++p) is_moved = squaredDistance(mean, places[p]) <= bound;
        if constexpr (kCompete) is_moved = is_moved || competesWithTouched(points, competition, id);
        is_moved = is_moved && reach_m >= 0;
        if (is_moved) atomicOr(moved.bits + (id >> 5), 1u << (id & 31));
      }
      const unsigned all = __ballot_sync(kAllLanes, is_moved);
      if (from / kWarp == lane) all_moved = all;
    }
    listMoved(moved, points.index.ids + first, all_moved, lane);
    for (int step = kWarp / 2; step > 0; step /= 2) most_m = fmaxf(most_m, __shfl_xor_sync(kAllLanes, most_m, step));
    if (lane == 0) points.index.reach_m[block] = most_m;  // smaller than before if points came closer together
    __syncwarp();
  }
}

}  // namespace

void launchFindMoved(const PointsView& points, const MovedView& moved, const CompetitionView& competition,
                     std::uint32_t max_touched, cudaStream_t stream) {
  if (max_touched == 0) return;
  const NeighbourRuleView& rule = points.rule;
  const double radius_m = static_cast<double>(neighbourReach_m(rule.radius_squared, rule.steps_per_m));
  const auto neighbours_voxels =
      static_cast<float>(radius_m * rule.inverse_voxel_size * static_cast<double>(kReachSlack)) +
      2 * static_cast<float>(kMeanRoundingVoxels);
  const float most_reach_voxels = fmaxf(neighbours_voxels, competition.reach_voxels);
  const bool compete = competition.choice.isMade();
  constexpr unsigned kThreads = kWarps * kWarp;
  const auto reach = compete ? reachBlocks<true> : reachBlocks<false>;
  reach<<<(max_touched + kWarps - 1) / kWarps, kThreads, 0, stream>>>(points, moved, competition, most_reach_voxels);
  checkLaunch("reachBlocks");
  constexpr unsigned kEnoughBlocks = 4096;
  const auto find = compete ? findMoved<true> : findMoved<false>;
  find<<<kEnoughBlocks, kThreads, 0, stream>>>(points, moved, competition);
  checkLaunch("findMoved");
}

}  // namespace accessvdb::kernels
