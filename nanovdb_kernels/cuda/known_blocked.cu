// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is known of a point's blocked directions, and how voxels that cease to collide wear it away (as
/// src/points/known_blocked.h): each takes at most one collision from a direction, so a direction stays blocked as long
/// as no more of them lie in its tool than it has collisions to spare.
#include "cuda/cuda_check.h"
#include "cuda/update_kernels.h"
#include "hostdev/occupancy_query.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 128, kLanes = 32, kWarps = kThreads / kLanes;
constexpr unsigned kAll = 0xffffffffu;
/// Freed voxels that a block of points looks at; where more lie near, nothing is known any more.
constexpr std::uint32_t kMostFreed = 2048;
constexpr int kWords32 = 2 * kMaxDirectionWords;

__global__ void addFreed(FreedView freed) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= freed.count) return;
  const std::int32_t* ijk = freed.voxels[n].ijk;
  constexpr int kShift = FreedView::kCellLog2;
  const std::uint32_t slot = freed.hash.insert(placeKey(ijk[0] >> kShift, ijk[1] >> kShift, ijk[2] >> kShift));
  freed.next[n] = atomicExch(freed.head + slot, n);
}

/// Freed voxels near a block, from its least voxel.
struct NearFreed {
  std::int16_t offset[kMostFreed][3];
  std::uint32_t count;
};

/// All threads: the voxels that some tool of some point of the block may cover.
__device__ void gather(const UpdateView& view, const std::int32_t* leaf, NearFreed& near) {
  const OffsetTableView& table = view.offsets;
  constexpr int kShift = FreedView::kCellLog2;
  int low[3], high[3], first[3], side[3];
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = leaf[axis] * 8 + table.low[axis];
    high[axis] = leaf[axis] * 8 + 7 + table.low[axis] + table.size[axis] - 1;
    first[axis] = low[axis] >> kShift;
    side[axis] = (high[axis] >> kShift) - first[axis] + 1;
  }
  const int cells = side[0] * side[1] * side[2];
  for (int n = static_cast<int>(threadIdx.x); n < cells; n += static_cast<int>(kThreads)) {
    const std::uint32_t slot = view.freed.hash.find(
        placeKey(first[0] + n / (side[1] * side[2]), first[1] + n / side[2] % side[1], first[2] + n % side[2]));
    if (slot == kNoIndex) continue;
    for (std::uint32_t at = view.freed.head[slot]; at != kNoIndex; at = view.freed.next[at]) {
      const std::int32_t* ijk = view.freed.voxels[at].ijk;
      bool inside = true;
      for (int axis = 0; axis < 3; ++axis) inside = inside && ijk[axis] >= low[axis] && ijk[axis] <= high[axis];
      if (!inside) continue;
      const std::uint32_t place = atomicAdd(&near.count, 1u);
      if (place >= kMostFreed) return;
      for (int axis = 0; axis < 3; ++axis)
        near.offset[place][axis] = static_cast<std::int16_t>(ijk[axis] - leaf[axis] * 8);
    }
  }
}

/// A warp: one point. @param hits  [D] of this warp, zero before and after
__device__ void releasePoint(const UpdateView& view, std::uint32_t id, const std::int32_t* leaf, const NearFreed& near,
                             std::uint32_t* hits, unsigned lane) {
  const int words32 = 2 * view.points.direction_words;
  auto* stored = reinterpret_cast<std::uint32_t*>(view.state.worse) +
                 static_cast<std::size_t>(id) * static_cast<std::size_t>(words32);
  std::uint32_t blocked[kWords32], any = 0;
  for (int w = 0; w < kWords32; ++w) {
    blocked[w] = w < words32 ? stored[w] : 0;
    any |= blocked[w];
  }
  if (any == 0) return;
  const float* p = view.points.position_L + 3 * static_cast<std::size_t>(id);
  // As the search places the tool.
  const Coord voxel = voxelOf(p[0], p[1], p[2], view.inverse_voxel_size);
  const OffsetTableView& table = view.offsets;
  for (std::uint32_t n = lane; n < near.count; n += kLanes) {
    std::int64_t entry = 0;
    bool inside = true;
    for (int axis = 0; axis < 3; ++axis) {
      const int i = near.offset[n][axis] + leaf[axis] * 8 - voxel[axis] - table.low[axis];
      inside = inside && i >= 0 && i < table.size[axis];
      entry = entry * table.size[axis] + i;
    }
    if (!inside) continue;
    const auto* reading = reinterpret_cast<const std::uint32_t*>(table.table) + entry * words32;
#pragma unroll
    for (int w = 0; w < kWords32; ++w) {
      if (w >= words32) break;
      for (std::uint32_t bits = reading[w] & blocked[w]; bits != 0; bits &= bits - 1) {
        atomicAdd(hits + 32 * w + __ffs(static_cast<int>(bits)) - 1, 1u);
      }
    }
  }
  __syncwarp();
  const std::uint32_t margin = view.state.margin[id];
  std::uint32_t worn = 0;
#pragma unroll
  for (int w = 0; w < kWords32; ++w) {
    const std::uint32_t mine = hits[32 * w + static_cast<int>(lane)];
    hits[32 * w + static_cast<int>(lane)] = 0;
    const unsigned freed = __ballot_sync(kAll, mine > margin);
    if (mine <= margin && mine > worn) worn = mine;
    if (lane == 0 && freed != 0) stored[w] = blocked[w] & ~freed;
  }
  worn = __reduce_max_sync(kAll, worn);
  if (lane == 0 && worn != 0) view.state.margin[id] = static_cast<std::uint8_t>(margin - worn);
  __syncwarp();
}

/// A block of threads a block of points.
__global__ void __launch_bounds__(kThreads) release(UpdateView view) {
  __shared__ NearFreed near;
  __shared__ std::uint32_t all_hits[kWarps][32 * kWords32];
  const std::uint32_t block = blockIdx.x;
  if (view.affected[block] == 0) return;
  const DirectionMask& better = view.masks[block].better_tool;
  if ((better.word[0] | better.word[1] | better.word[2] | better.word[3]) == 0) return;
  const std::int32_t* leaf = view.index.leaf + 3 * static_cast<std::size_t>(block);
  const unsigned warp = threadIdx.x / kLanes, lane = threadIdx.x % kLanes;
  for (unsigned n = lane; n < 32 * kWords32; n += kLanes) all_hits[warp][n] = 0;
  if (threadIdx.x == 0) near.count = 0;
  __syncthreads();
  gather(view, leaf, near);
  __syncthreads();
  const std::uint32_t first = view.index.first[block], count = view.index.count[block];
  if (near.count == 0) return;
  if (near.count > kMostFreed) {
    const auto words = static_cast<std::uint32_t>(view.points.direction_words);
    for (std::uint32_t i = threadIdx.x; i < count * words; i += kThreads) {
      view.state.worse[view.index.ids[first + i / words] * std::size_t{words} + i % words] = 0;
    }
    return;
  }
  for (std::uint32_t i = warp; i < count; i += kWarps) {
    releasePoint(view, view.index.ids[first + i], leaf, near, all_hits[warp], lane);
  }
}

}  // namespace

void launchAddFreed(const UpdateView& view, cudaStream_t stream) {
  if (view.freed.count == 0) return;
  addFreed<<<(view.freed.count + kThreads - 1) / kThreads, kThreads, 0, stream>>>(view.freed);
  checkLaunch("addFreed");
}

void launchRelease(const UpdateView& view, cudaStream_t stream) {
  if (view.freed.count == 0 || view.index.blocks == 0) return;
  release<<<view.index.blocks, kThreads, 0, stream>>>(view);
  checkLaunch("release");
}

}  // namespace accessvdb::kernels
