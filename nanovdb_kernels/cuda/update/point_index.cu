// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// New and touched points: their state, and where they lie.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__device__ void enterBlock(const BlockIndexView& index, std::uint32_t block) {
  const std::int32_t* leaf = index.leaf + 3 * static_cast<std::size_t>(block);
  index.block_at[index.hash.insert(placeKey(leaf[0], leaf[1], leaf[2]))] = block;
}

/// A warp a block.
__global__ void admitBlocks(UpdateView view, const BlockNews* blocks, const std::uint32_t* block_ids,
                            std::uint32_t count) {
  const std::uint32_t n = (blockIdx.x * kThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= count) return;
  const BlockNews& news = blocks[n];
  const BlockIndexView& index = view.index;
  for (std::uint32_t i = lane; i < news.count; i += kWarp) index.ids[news.first + i] = block_ids[news.source + i];
  if (lane != 0) return;
  index.first[news.block] = news.first;
  index.count[news.block] = news.count;
  if (news.is_new == 0) return;
  for (int axis = 0; axis < 3; ++axis) index.leaf[3 * static_cast<std::size_t>(news.block) + axis] = news.leaf[axis];
  index.reach_m[news.block] = -1;
  view.groups.of_block[news.block] = news.group;
  for (int axis = 0; axis < 3; ++axis) {  // the same, whichever block of the group comes
    view.groups.leaf[3 * static_cast<std::size_t>(news.group) + axis] = news.leaf[axis] >> view.groups.log2
                                                                                               << view.groups.log2;
  }
  enterBlock(index, news.block);
}

__global__ void rehash(BlockIndexView index) {
  const std::uint32_t block = blockIdx.x * kThreads + threadIdx.x;
  if (block < index.blocks) enterBlock(index, block);
}

__device__ void makePoint(const UpdateView& view, const PointNews& news) {
  const std::size_t id = news.id;
  view.state.block[id] = news.block;
  view.state.reach_m[id] = -1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    view.points.position_L[3 * id + axis] = news.position_L[axis];
    view.points.normal_L[3 * id + axis] = 0;
  }
  const auto words = static_cast<std::size_t>(view.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) view.points.seen[id * words + w] = 0;
  if (view.known.levels != nullptr) {
    const auto known_words = static_cast<std::size_t>(view.known.words);
    for (std::size_t w = 0; w < known_words; ++w) view.known.levels[id * known_words + w] = 0;
  }
  view.points.stability[id] = 1;
  view.points.weight[id] = 0;
  view.points.score[id] = kNoScore;
  view.points.direction[id] = kNoDirection;
  view.points.label[id] = PointLabel::Unscored;
  view.points.reason[id] = PointReason::Confidence;
}

__device__ void addMoved(const UpdateView& view, std::uint32_t id) {
  if (view.state.moved_bits == nullptr) return;
  const std::uint32_t bit = 1u << (id & 31);
  if ((atomicOr(view.state.moved_bits + (id >> 5), bit) & bit) != 0) return;
  view.moved[atomicAdd(&view.counters->moved, 1u)] = id;
}

__global__ void admitPoints(UpdateView view, const PointNews* all_news, std::uint32_t count,
                            std::uint32_t first_place) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const PointNews& news = all_news[n];
  const std::size_t id = news.id;
  if (isnan(news.before_L[0])) {
    makePoint(view, news);
  } else if (view.state.reach_m[id] >= 0) {
    addMoved(view, news.id);  // its mean, its seen directions or the mean sensor position are others now
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    view.state.mean_L[3 * id + axis] = news.mean_L[axis];
    view.state.to_sensor_L[3 * id + axis] = news.to_sensor_L[axis];
  }
  for (int w = 0; w < view.points.direction_words; ++w) {
    view.state.own_seen[id * static_cast<std::size_t>(view.points.direction_words) + static_cast<std::size_t>(w)] =
        news.seen.word[w];
  }
  if (first_place == kNoIndex) return;
  const std::uint32_t at = first_place + n;
  Place& place = view.places.places[at];
  for (int axis = 0; axis < 3; ++axis) {
    place.now_L[axis] = news.mean_L[axis];
    place.before_L[axis] = news.before_L[axis];
  }
  place.next = atomicExch(view.places.head + news.block, at);
  if (place.next == kNoIndex) view.places.touched_blocks[atomicAdd(&view.counters->touched_blocks, 1u)] = news.block;
}

__global__ void setWeights(UpdateView view, const PointWeight* weights, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < count) view.points.weight[weights[n].id] = weights[n].weight;
}

__global__ void addCrossed(UpdateView view, const PointWeight* points, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  view.points.weight[points[n].id] = points[n].weight;  // the returns may be those of its neighbours
  addMoved(view, points[n].id);
}

}  // namespace

void launchAdmitBlocks(const UpdateView& view, const BlockNews* blocks, const std::uint32_t* block_ids,
                       std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  admitBlocks<<<blocksFor(std::uint64_t{count} * kWarp), kThreads, 0, stream>>>(view, blocks, block_ids, count);
  checkLaunch("admitBlocks");
}

void launchRehash(const BlockIndexView& index, cudaStream_t stream) {
  if (index.blocks == 0) return;
  rehash<<<blocksFor(index.blocks), kThreads, 0, stream>>>(index);
  checkLaunch("rehash");
}

void launchAdmitPoints(const UpdateView& view, const PointNews* news, std::uint32_t count, std::uint32_t first_place,
                       cudaStream_t stream) {
  if (count == 0) return;
  admitPoints<<<blocksFor(count), kThreads, 0, stream>>>(view, news, count, first_place);
  checkLaunch("admitPoints");
}

void launchSetWeights(const UpdateView& view, const PointWeight* weights, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  setWeights<<<blocksFor(count), kThreads, 0, stream>>>(view, weights, count);
  checkLaunch("setWeights");
}

void launchAddCrossed(const UpdateView& view, const PointWeight* points, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  addCrossed<<<blocksFor(count), kThreads, 0, stream>>>(view, points, count);
  checkLaunch("addCrossed");
}

}  // namespace accessvdb::kernels
