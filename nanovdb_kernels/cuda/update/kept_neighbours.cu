// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The neighbourhoods of points whose neighbours are the same points as before, only moved: by difference
/// (hostdev/kept_neighbours.h). What this does not find out is left to cell_neighbours.cu.
#include "cuda/memory/cuda_check.h"
#include "cuda/update/near_blocks.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4, kThreads = kWarps * kWarp;
/// Touched points near a block that a warp keeps; if there are more, its points are searched.
constexpr unsigned kMostTouched = 128;

struct TouchedNear {
  float now_L[kMostTouched][3], before_L[kMostTouched][3];
  std::uint32_t id[kMostTouched];
  std::uint32_t count;
};

/// Makes the neighbourhood of one point. One thread. @return false: it must be searched
__device__ bool takeOver(const PointsView& points, std::uint32_t id, const TouchedNear& touched,
                         FoundNeighbourhood& out) {
  KeptNeighbours kept = points.state.kept[id];
  if (kept.farthest == KeptNeighbours::kNone) return false;
  const float* const mean = points.meanOf(id);
  const float reach_m = points.state.reach_m[id], bound = reach_m * reach_m * kReachSlack;
  const auto words = static_cast<std::size_t>(points.points.direction_words);
  DirectionMask seen = {};
  for (std::size_t w = 0; w < words; ++w) seen.word[w] = points.points.seen[id * words + w];
  for (std::uint32_t n = 0; n < touched.count; ++n) {
    const float *const now_L = touched.now_L[n], *const before_L = touched.before_L[n];
    if (touched.id[n] == id) return false;
    if (!(squaredDistance(mean, now_L) <= bound) && !(squaredDistance(mean, before_L) <= bound)) continue;
    const NeighbourOffset now = neighbourOffset(mean, now_L, points.rule.steps_per_m);
    if (isnan(before_L[0])) {
      if (!kept.ignoreNew(now)) return false;
      continue;
    }
    bool shares = false;
    if (!kept.take(neighbourOffset(mean, before_L, points.rule.steps_per_m), now, shares)) return false;
    if (!shares) continue;
    const std::uint64_t* const other = points.state.own_seen + touched.id[n] * words;
    for (std::size_t w = 0; w < words; ++w) seen.word[w] |= other[w];
  }
  neighbourNormal(kept.sums(), points.state.to_sensor_L + 3 * static_cast<std::size_t>(id), out.normal);
  out.reach_m = reach_m;
  out.seen = seen;
  points.state.kept[id] = kept;
  return true;
}

/// One warp per block with moved points.
__global__ void __launch_bounds__(kThreads) takeOverKept(PointsView points, MovedView moved, MovedRange range) {
  __shared__ TouchedNear all_touched[kWarps];
  const unsigned warp = threadIdx.x / kWarp, lane = threadIdx.x % kWarp;
  TouchedNear& touched = all_touched[warp];
  if (!moved.counters->mostlyKnown()) return;
  const std::uint32_t blocks = moved.counters->moved_blocks;
  for (std::uint32_t n = blockIdx.x * kWarps + warp; n < blocks; n += gridDim.x * kWarps) {
    const MovedBlock of = moved.blocks[n];
    const std::uint32_t begin = max(of.first, range.begin), end = min(of.first + of.count, range.end);
    if (begin >= end) continue;
    const std::uint32_t block = points.state.block[moved.ids[begin]];
    const std::int32_t* const leaf = points.index.leaf + 3 * static_cast<std::size_t>(block);
    if (lane == 0) touched.count = 0;
    __syncwarp();
    forEachNear(points.index, leaf, blockReachVoxels(points, points.index.reach_m[block]), lane,
                [&](std::uint32_t near, float) {
                  if (near == kNoIndex) return;
                  std::uint32_t next = 0;
                  for (std::uint32_t at = moved.places.head[near]; at != kNoIndex; at = next) {
                    const TouchedPlace& place = moved.places.places[at];
                    next = place.next;
                    const std::uint32_t to = atomicAdd(&touched.count, 1u);
                    if (to >= kMostTouched) continue;
                    touched.id[to] = place.id;
                    for (int axis = 0; axis < 3; ++axis) {
                      touched.now_L[to][axis] = place.now_L[axis];
                      touched.before_L[to][axis] = place.before_L[axis];
                    }
                  }
                });
    __syncwarp();
    for (std::uint32_t at = begin + lane; at < end; at += kWarp) {
      FoundNeighbourhood& out = range.to[at - range.begin];
      if (touched.count > kMostTouched || !takeOver(points, moved.ids[at], touched, out)) {
        out.reach_m = MovedRange::kSearched;
      }
    }
    __syncwarp();  // the list is overwritten next
  }
}

__global__ void forgetKept(PointsView points, MovedView moved) {
  const std::uint32_t count = moved.counters->moved;
  for (std::uint32_t n = blockIdx.x * kThreads + threadIdx.x; n < count; n += gridDim.x * kThreads) {
    points.state.kept[moved.ids[n]].farthest = KeptNeighbours::kNone;
  }
}

}  // namespace

void launchTakeOverKept(const PointsView& points, const MovedView& moved, const MovedRange& range, int multiprocessors,
                        cudaStream_t stream) {
  if (range.begin == range.end || points.state.kept == nullptr) return;
  constexpr unsigned kBlocksEach = 8;
  takeOverKept<<<static_cast<unsigned>(multiprocessors) * kBlocksEach, kThreads, 0, stream>>>(points, moved, range);
  checkLaunch("takeOverKept");
}

void launchForgetKept(const PointsView& points, const MovedView& moved, cudaStream_t stream) {
  if (points.state.kept == nullptr) return;
  constexpr unsigned kEnoughBlocks = 1024;
  forgetKept<<<kEnoughBlocks, kThreads, 0, stream>>>(points, moved);
  checkLaunch("forgetKept");
}

}  // namespace accessvdb::kernels
