// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// New and touched points: their state, and where they lie.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__device__ void enterBlock(const BlockIndexView& index, std::uint32_t block) {
  const std::int32_t* leaf = index.leaf + 3 * static_cast<std::size_t>(block);
  index.block_at[index.hash.insert(placeKey(leaf[0], leaf[1], leaf[2]))] = block;
}

/// One warp per block.
__global__ void admitBlocks(BlockIndexView index, GroupsView groups, DeviceList<BlockDelta> blocks,
                            const std::uint32_t* block_ids) {
  const std::uint32_t n = (blockIdx.x * kThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= blocks.count) return;
  const BlockDelta& delta = blocks.data[n];
  for (std::uint32_t i = lane; i < delta.count; i += kWarp) index.ids[delta.first + i] = block_ids[delta.source + i];
  if (lane != 0) return;
  index.first[delta.block] = delta.first;
  index.count[delta.block] = delta.count;
  if (delta.is_new == 0) return;
  for (int axis = 0; axis < 3; ++axis) index.leaf[3 * static_cast<std::size_t>(delta.block) + axis] = delta.leaf[axis];
  index.reach_m[delta.block] = -1;
  groups.of_block[delta.block] = delta.group;
  for (int axis = 0; axis < 3; ++axis) {  // every block of a group writes the same
    groups.leaf[3 * static_cast<std::size_t>(delta.group) + axis] = delta.leaf[axis] >> groups.log2 << groups.log2;
  }
  enterBlock(index, delta.block);
}

__global__ void rehash(BlockIndexView index) {
  const std::uint32_t block = blockIdx.x * kThreads + threadIdx.x;
  if (block < index.blocks) enterBlock(index, block);
}

/// Initialises the state that a tool keeps for a point: nothing is known yet.
__device__ void makeState(const PointStateView& state, const KnownView& known, std::size_t id) {
  if (known.notes != nullptr) known.notes[id] = KnownSlots::kNothingHeld;
  if (known.remembers()) {
    const auto words = static_cast<std::size_t>(known.slots.slots);
    for (std::size_t w = 0; w < words; ++w) {
      if (known.follows) {
        reinterpret_cast<KnownCounts*>(known.counts)[id * words + w] = KnownCounts::unknown();
      } else {
        known.levels[id * words + w] = 0;
      }
    }
  }
  state.stability[id] = 1;
  state.score[id] = kNoScore;
  state.direction[id] = kNoDirection;
  if (state.roll != nullptr) state.roll[id] = 0;
  state.label[id] = PointLabel::Unscored;
  state.reason[id] = PointReason::Confidence;
}

/// Initialises the state of a point that all tools share.
__device__ void makePoint(const PointsView& points, const PointDelta& delta) {
  const PointStateView& state = points.points;
  const std::size_t id = delta.id;
  points.state.block[id] = delta.block;
  points.state.reach_m[id] = -1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    state.position_L[3 * id + axis] = delta.position_L[axis];
    state.normal_L[3 * id + axis] = 0;
  }
  const auto words = static_cast<std::size_t>(state.direction_words);
  for (std::size_t w = 0; w < words; ++w) state.seen[id * words + w] = 0;
  state.weight[id] = 0;
}

__device__ void addMoved(const MovedView& moved, std::uint32_t id) {
  const std::uint32_t bit = 1u << (id & 31);
  if ((atomicOr(moved.bits + (id >> 5), bit) & bit) != 0) return;
  moved.ids[atomicAdd(&moved.counters->moved, 1u)] = id;
}

__global__ void admitPoints(PointsView points, MovedView moved, KnownView known, DeviceList<PointDelta> deltas,
                            std::uint32_t first_place) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= deltas.count) return;
  const PointDelta& delta = deltas.data[n];
  const NeighbourStateView& state = points.state;
  const std::size_t id = delta.id;
  if (isnan(delta.before_L[0])) {
    makePoint(points, delta);
    makeState(points.points, known, id);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    state.mean_L[3 * id + axis] = delta.mean_L[axis];
    state.to_sensor_L[3 * id + axis] = delta.to_sensor_L[axis];
  }
  const auto words = static_cast<std::size_t>(points.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) state.own_seen[id * words + w] = delta.seen.word[w];
  if (first_place == kNoIndex) return;
  const PlacesView& places = moved.places;
  const std::uint32_t at = first_place + n;
  TouchedPlace& place = places.places[at];
  for (int axis = 0; axis < 3; ++axis) {
    place.now_L[axis] = delta.mean_L[axis];
    place.before_L[axis] = delta.before_L[axis];
  }
  place.id = delta.id;
  atomicAdd(&moved.counters->touched, 1u);
  if (isnan(delta.before_L[0])) atomicAdd(&moved.counters->touched_new, 1u);
  place.next = atomicExch(places.head + delta.block, at);
  if (place.next == kNoIndex) places.touched_blocks[atomicAdd(&moved.counters->touched_blocks, 1u)] = delta.block;
}

__global__ void admitStates(PointStateView state, KnownView known, DeviceList<PointDelta> deltas) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < deltas.count && isnan(deltas.data[n].before_L[0])) makeState(state, known, deltas.data[n].id);
}

__global__ void setWeights(PointStateView points, DeviceList<PointWeight> weights) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < weights.count) points.weight[weights.data[n].id] = weights.data[n].weight;
}

__global__ void addCrossed(PointStateView points, MovedView moved, DeviceList<PointWeight> crossed) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= crossed.count) return;
  const PointWeight& point = crossed.data[n];
  points.weight[point.id] = point.weight;  // returns in voxels beside it may have raised it
  addMoved(moved, point.id);
}

}  // namespace

void launchAdmitBlocks(const PointsView& points, DeviceList<BlockDelta> blocks, const std::uint32_t* block_ids,
                       cudaStream_t stream) {
  if (blocks.count == 0) return;
  admitBlocks<<<blocksFor(std::uint64_t{blocks.count} * kWarp), kThreads, 0, stream>>>(points.index, points.groups,
                                                                                       blocks, block_ids);
  checkLaunch("admitBlocks");
}

void launchRehash(const BlockIndexView& index, cudaStream_t stream) {
  if (index.blocks == 0) return;
  rehash<<<blocksFor(index.blocks), kThreads, 0, stream>>>(index);
  checkLaunch("rehash");
}

void launchAdmitPoints(const PointsView& points, const MovedView& moved, const KnownView& known,
                       DeviceList<PointDelta> deltas, std::uint32_t first_place, cudaStream_t stream) {
  if (deltas.count == 0) return;
  admitPoints<<<blocksFor(deltas.count), kThreads, 0, stream>>>(points, moved, known, deltas, first_place);
  checkLaunch("admitPoints");
}

void launchAdmitStates(const PointStateView& state, const KnownView& known, DeviceList<PointDelta> deltas,
                       cudaStream_t stream) {
  if (deltas.count == 0) return;
  admitStates<<<blocksFor(deltas.count), kThreads, 0, stream>>>(state, known, deltas);
  checkLaunch("admitStates");
}

void launchSetWeights(const PointStateView& points, DeviceList<PointWeight> weights, cudaStream_t stream) {
  if (weights.count == 0) return;
  setWeights<<<blocksFor(weights.count), kThreads, 0, stream>>>(points, weights);
  checkLaunch("setWeights");
}

void launchAddCrossed(const PointStateView& points, const MovedView& moved, DeviceList<PointWeight> crossed,
                      cudaStream_t stream) {
  if (crossed.count == 0) return;
  addCrossed<<<blocksFor(crossed.count), kThreads, 0, stream>>>(points, moved, crossed);
  checkLaunch("addCrossed");
}

}  // namespace accessvdb::kernels
