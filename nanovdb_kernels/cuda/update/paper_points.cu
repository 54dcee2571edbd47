// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy: what to try at the points whose turn it is, and what came of it.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/paper_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__global__ void setConfident(std::uint8_t* flags, DeviceList<PointWeight> points, std::uint32_t* ids) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= points.count) return;
  ids[n] = points.data[n].id;
  flags[points.data[n].id] |= kConfidentPoint;
}

/// Orders points by distance, ties by id. Distances are not negative, so they order like their bits.
__device__ std::uint64_t nearKey(float distance_m, std::uint32_t id) {
  return std::uint64_t{__float_as_uint(distance_m)} << 32 | id;
}

/// Lowers `nearest` to the key of the nearest resolved point of a leaf, other than point `id`.
__device__ void takeNearest(const PointsView& points, const std::int32_t (&leaf)[3], std::uint32_t id,
                            std::uint16_t collision_limit, std::uint64_t& nearest) {
  const std::uint32_t block = points.index.find(leaf[0], leaf[1], leaf[2]);
  if (block == kNoIndex) return;
  const float* here = points.points.position_L + 3 * static_cast<std::size_t>(id);
  const std::uint32_t first = points.index.first[block], count = points.index.count[block];
  for (std::uint32_t p = first; p < first + count; ++p) {
    const std::uint32_t other = points.index.ids[p];
    if (other == id) continue;
    if (!isResolved(points.points.score[other], points.points.direction[other], collision_limit)) continue;
    const float distance_m = distanceBetween_m(points.points.position_L + 3 * static_cast<std::size_t>(other), here);
    const std::uint64_t key = nearKey(distance_m, other);
    if (key < nearest) nearest = key;
  }
}

/// Finds the nearest resolved point, ties by lower id, ring by ring of blocks. One warp per point.
__global__ void findHints(PointsView points, CoarseToFine rule, std::uint16_t collision_limit,
                          DeviceList<std::uint32_t> ids, std::uint16_t* hints) {
  const std::uint32_t n = (blockIdx.x * kThreads + threadIdx.x) / kWarp, lane = threadIdx.x % kWarp;
  if (n >= ids.count) return;
  const std::uint32_t id = ids.data[n];
  const std::int32_t* leaf = points.index.leaf + 3 * static_cast<std::size_t>(points.state.block[id]);
  const float block_m = 8 * points.rule.voxel_size_m;
  const int last_ring = static_cast<int>(rule.radius_m / block_m) + 1;
  std::uint64_t nearest = nearKey(rule.radius_m, kNoIndex);
  for (int ring = 0; ring <= last_ring; ++ring) {
    if (static_cast<float>(ring - 1) * block_m > __uint_as_float(static_cast<std::uint32_t>(nearest >> 32))) break;
    const int side = 2 * ring + 1;
    for (int i = static_cast<int>(lane); i < side * side; i += static_cast<int>(kWarp)) {
      // A column of the ring's cube: all of it on the sides, else only its ends.
      const int dx = i / side - ring, dy = i % side - ring;
      const bool whole = dx == -ring || dx == ring || dy == -ring || dy == ring;
      for (int dz = -ring; dz <= ring; dz += whole ? 1 : 2 * ring) {
        takeNearest(points, {leaf[0] + dx, leaf[1] + dy, leaf[2] + dz}, id, collision_limit, nearest);
      }
    }
    for (int step = kWarp / 2; step > 0; step /= 2) {
      const std::uint64_t other = __shfl_xor_sync(kAllLanes, nearest, step);
      if (other < nearest) nearest = other;
    }
  }
  const auto found = static_cast<std::uint32_t>(nearest);
  if (lane == 0) hints[n] = found == kNoIndex ? kNoDirection : points.points.direction[found];
}

__global__ void takeTurn(PointsView points, CoarseToFine rule, PaperTurn turn) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= turn.count) return;
  const std::size_t id = turn.ids[n];
  const FoundNeighbourhood& found = turn.neighbourhoods[n];
  turn.flags[id] &= static_cast<std::uint8_t>(~kWaiting);
  points.state.reach_m[id] = found.reach_m;
  for (std::size_t axis = 0; axis < 3; ++axis) points.points.normal_L[3 * id + axis] = found.normal[axis];
  const auto words = static_cast<std::size_t>(points.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) points.points.seen[id * words + w] = found.seen.word[w];
  ScoreItem item;
  item.id = turn.ids[n];
  item.candidates = rule.candidates(turn.hints != nullptr ? turn.hints[n] : kNoDirection);
  turn.items[n] = item;
  turn.labels_before[n] = points.points.label[id];
}

__global__ void tallyTurn(PaperTurn turn, std::uint16_t collision_limit, UpdateCounters* all_counters) {
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
  OutcomeCounters* const counters = &all_counters->outcome;
  atomicAdd(&counters->tests, static_cast<unsigned long long>(tests));
  atomicAdd(&counters->scored, static_cast<unsigned long long>(scored));
  atomicAdd(&counters->label_changes, static_cast<unsigned long long>(changes));
  atomicAdd(&all_counters->resolved, resolved);
}

}  // namespace

void launchSetConfident(std::uint8_t* flags, DeviceList<PointWeight> points, std::uint32_t* ids, cudaStream_t stream) {
  if (points.count == 0) return;
  setConfident<<<blocksFor(points.count), kThreads, 0, stream>>>(flags, points, ids);
  checkLaunch("setConfident");
}

void launchFindHints(const PointsView& points, const HintRule& rule, DeviceList<std::uint32_t> ids,
                     std::uint16_t* hints, cudaStream_t stream) {
  if (ids.count == 0) return;
  findHints<<<blocksFor(std::uint64_t{ids.count} * kWarp), kThreads, 0, stream>>>(points, rule.candidates,
                                                                                  rule.collision_limit, ids, hints);
  checkLaunch("findHints");
}

void launchTakeTurn(const PointsView& points, const CoarseToFine& rule, const PaperTurn& turn, cudaStream_t stream) {
  if (turn.count == 0) return;
  takeTurn<<<blocksFor(turn.count), kThreads, 0, stream>>>(points, rule, turn);
  checkLaunch("takeTurn");
}

void launchTallyTurn(const PaperTurn& turn, std::uint16_t collision_limit, UpdateCounters* counters,
                     cudaStream_t stream) {
  if (turn.count == 0) return;
  tallyTurn<<<blocksFor(turn.count), kThreads, 0, stream>>>(turn, collision_limit, counters);
  checkLaunch("tallyTurn");
}

}  // namespace accessvdb::kernels
