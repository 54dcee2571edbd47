// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy: what is tried at the points whose turn it is, and what came of it.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/paper_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__global__ void setConfident(std::uint8_t* flags, const PointWeight* points, std::uint32_t count, std::uint32_t* ids) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  ids[n] = points[n].id;
  flags[points[n].id] |= kConfidentPoint;
}

/// Orders points by distance, ties by id. Distances are not negative, so they are in the order of their bits.
__device__ std::uint64_t nearKey(float distance_m, std::uint32_t id) {
  return std::uint64_t{__float_as_uint(distance_m)} << 32 | id;
}

/// Lowers the key to that of the nearest resolved point of a block, without point `id`.
__device__ void takeNearest(const UpdateView& view, std::int32_t x, std::int32_t y, std::int32_t z, std::uint32_t id,
                            std::uint64_t& nearest) {
  const std::uint32_t block = view.index.find(x, y, z);
  if (block == kNoIndex) return;
  const float* here = view.points.position_L + 3 * static_cast<std::size_t>(id);
  const std::uint32_t first = view.index.first[block], points = view.index.count[block];
  for (std::uint32_t p = first; p < first + points; ++p) {
    const std::uint32_t other = view.index.ids[p];
    if (other == id) continue;
    if (!isResolved(view.points.score[other], view.points.direction[other], view.update_rule.collision_limit)) continue;
    const float distance_m = distanceBetween_m(view.points.position_L + 3 * static_cast<std::size_t>(other), here);
    const std::uint64_t key = nearKey(distance_m, other);
    if (key < nearest) nearest = key;
  }
}

/// The nearest resolved point, ties by lower id, ring by ring of blocks. A warp a point.
__global__ void findHints(UpdateView view, CoarseToFine rule, const std::uint32_t* ids, std::uint32_t count,
                          std::uint16_t* hints) {
  const std::uint32_t n = (blockIdx.x * kThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= count) return;
  const std::uint32_t id = ids[n];
  const std::int32_t* leaf = view.index.leaf + 3 * static_cast<std::size_t>(view.state.block[id]);
  const float block_m = 8 * view.rule.voxel_size_m;
  const int last_ring = static_cast<int>(rule.radius_m / block_m) + 1;
  std::uint64_t nearest = nearKey(rule.radius_m, kNoIndex);
  for (int ring = 0; ring <= last_ring; ++ring) {
    if (static_cast<float>(ring - 1) * block_m > __uint_as_float(static_cast<std::uint32_t>(nearest >> 32))) break;
    const int side = 2 * ring + 1;
    for (int i = static_cast<int>(lane); i < side * side; i += static_cast<int>(kWarp)) {
      // A column of the ring's cube: all of it at the sides, else its ends.
      const int dx = i / side - ring, dy = i % side - ring;
      const bool whole = dx == -ring || dx == ring || dy == -ring || dy == ring;
      for (int dz = -ring; dz <= ring; dz += whole ? 1 : 2 * ring) {
        takeNearest(view, leaf[0] + dx, leaf[1] + dy, leaf[2] + dz, id, nearest);
      }
    }
    for (int step = kWarp / 2; step > 0; step /= 2) {
      const std::uint64_t other = __shfl_xor_sync(kAllLanes, nearest, step);
      if (other < nearest) nearest = other;
    }
  }
  const auto found = static_cast<std::uint32_t>(nearest);
  if (lane == 0) hints[n] = found == kNoIndex ? kNoDirection : view.points.direction[found];
}

__global__ void takeTurn(UpdateView view, CoarseToFine rule, PaperTurn turn) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= turn.count) return;
  const std::size_t id = turn.ids[n];
  const Neighbourhood& found = turn.neighbourhoods[n];
  view.waiting[id] &= static_cast<std::uint8_t>(~kWaiting);
  view.state.reach_m[id] = found.reach_m;
  for (std::size_t axis = 0; axis < 3; ++axis) view.points.normal_L[3 * id + axis] = found.normal[axis];
  const auto words = static_cast<std::size_t>(view.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) view.points.seen[id * words + w] = found.seen.word[w];
  ScoreItem item;
  item.id = turn.ids[n];
  item.candidates = rule.candidates(turn.hints != nullptr ? turn.hints[n] : kNoDirection);
  turn.items[n] = item;
  turn.labels_before[n] = view.points.label[id];
}

__global__ void tallyTurn(PaperTurn turn, std::uint16_t collision_limit, UpdateCounters* counters) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  unsigned tests = 0, scored = 0, changes = 0, resolved = 0;
  if (n < turn.count) {
    const ScoreResult& result = turn.results[n];
    tests = result.tests;
    scored = result.tests > 0 ? 1 : 0;
    changes = result.label != turn.labels_before[n] ? 1 : 0;
    resolved = isResolved(result.stored_score, result.stored_direction, collision_limit) ? 1 : 0;
  }
  tests = __reduce_add_sync(kAllLanes, tests);
  scored = __reduce_add_sync(kAllLanes, scored);
  changes = __reduce_add_sync(kAllLanes, changes);
  resolved = __reduce_add_sync(kAllLanes, resolved);
  if (threadIdx.x % kWarp != 0) return;
  atomicAdd(&counters->tests, static_cast<unsigned long long>(tests));
  atomicAdd(&counters->scored, static_cast<unsigned long long>(scored));
  atomicAdd(&counters->label_changes, static_cast<unsigned long long>(changes));
  atomicAdd(&counters->resolved, resolved);
}

}  // namespace

void launchSetConfident(std::uint8_t* flags, const PointWeight* points, std::uint32_t count, std::uint32_t* ids,
                        cudaStream_t stream) {
  if (count == 0) return;
  setConfident<<<blocksFor(count), kThreads, 0, stream>>>(flags, points, count, ids);
  checkLaunch("setConfident");
}

void launchFindHints(const UpdateView& view, const CoarseToFine& rule, const std::uint32_t* ids, std::uint32_t count,
                     std::uint16_t* hints, cudaStream_t stream) {
  if (count == 0) return;
  findHints<<<blocksFor(std::uint64_t{count} * kWarp), kThreads, 0, stream>>>(view, rule, ids, count, hints);
  checkLaunch("findHints");
}

void launchTakeTurn(const UpdateView& view, const CoarseToFine& rule, const PaperTurn& turn, cudaStream_t stream) {
  if (turn.count == 0) return;
  takeTurn<<<blocksFor(turn.count), kThreads, 0, stream>>>(view, rule, turn);
  checkLaunch("takeTurn");
}

void launchTallyTurn(const PaperTurn& turn, std::uint16_t collision_limit, UpdateCounters* counters,
                     cudaStream_t stream) {
  if (turn.count == 0) return;
  tallyTurn<<<blocksFor(turn.count), kThreads, 0, stream>>>(turn, collision_limit, counters);
  checkLaunch("tallyTurn");
}

}  // namespace accessvdb::kernels
