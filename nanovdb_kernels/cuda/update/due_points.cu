// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lists the points to evaluate, by the rule of hostdev/due_rule.h: after their neighbourhoods changed, after flips
/// near them, and when their turn has come. Flips are handled leaf by leaf, for groups of blocks.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/due_rule.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256, kWarps = kThreads / kWarp;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__device__ PointDirections directionsOf(const PointStateView& points, std::size_t id) {
  PointDirections now;
  for (std::size_t axis = 0; axis < 3; ++axis) now.normal[axis] = points.normal_L[3 * id + axis];
  now.seen = {};
  const auto words = static_cast<std::size_t>(points.direction_words);
  for (std::size_t w = 0; w < words; ++w) now.seen.word[w] = points.seen[id * words + w];
  return now;
}

__device__ StoredScore storedScore(const PointStateView& points, std::size_t id) {
  return {points.label[id], points.direction[id], points.score[id], points.rollOf(static_cast<std::uint32_t>(id))};
}

/// Whether collisions at a scored point of an affected group may have changed so that it matters.
__device__ bool toolMatters(const DueContext& context, std::uint32_t id) {
  const KnownView& known = context.evaluation.known;
  return !known.follows || isSet(known.stirred_bits, id);
}

/// What flips mean for a point; read only if the rule asks.
struct FlipsOfPoint {
  const DueContext& context;
  std::uint32_t id;

  __device__ GroupMasks masks() const {
    if (context.masks.affected == nullptr) return {};
    const std::uint32_t group = context.points.groupOf(id);
    if (context.masks.affected[group] == 0) return {};
    GroupMasks masks = context.masks.masks[group];
    if (!toolMatters(context, id)) masks.better_tool = masks.worse_tool = {};
    return masks;
  }
  __device__ std::uint64_t notKnownWorse(int w, std::uint64_t asked, int most) const {
    return kernels::notKnownWorse(context.points, context.evaluation.known, id, w, asked, most);
  }
  __device__ int collisionsOf(int direction) const {
    const KnownView& known = context.evaluation.known;
    if (!known.follows) return kNoScore;
    const std::uint16_t count = knownCount(known, KnownRow(context.points, known, id), direction);
    return count == known_count::kUnknown ? kNoScore : count;
  }
  __device__ bool bestArmMayBeBlocked() const {
    return context.masks.arm_bits == nullptr || isSet(context.masks.arm_bits, id);
  }
  __device__ int limit() const { return context.evaluation.rule.collision_limit; }
};

/// Adds a point to this update's list.
__device__ void append(const DueContext& context, std::uint32_t id, const Due& what) {
  const DueView& due = context.due;
  const std::uint32_t block = context.points.state.block[id];
  const std::uint32_t n = atomicAdd(&due.counters->due, 1u);
  due.items[n] = {id, kNoIndex, what};
  const std::uint32_t next = atomicExch(due.head + block, n);
  due.items[n].next = next;
  if (next == kNoIndex) due.busy[atomicAdd(&due.counters->busy, 1u)] = block;
}

/// Confirms an accessible point whose best direction is still the best: nothing to test.
__device__ void confirm(const PointStateView& points, const UpdateRule& rule, std::uint32_t id, const Due& due) {
  ScoreItem item;
  item.id = id;
  item.evidence = due.evidence;
  ScoreResult result;
  result.scored = 1;
  result.score = due.best_score != kNoScore ? due.best_score : points.score[id];
  result.direction = points.direction[id];
  result.roll = static_cast<std::uint8_t>(points.rollOf(id));
  result.reason = PointReason::None;
  updatePoint(points, item, result, rule);
}

/// Lists a point for evaluation, or marks it to wait for its turn. One that already waits is only marked: what is due
/// is decided when its turn comes.
/// @param before  its directions at the last update; equal to `now` if they did not change
__device__ void takeDue(const DueContext& context, std::uint32_t id, const PointDirections& before,
                        const PointDirections& now, bool changed) {
  std::uint8_t* const waiting = context.due.waiting;
  if (waiting != nullptr && (waiting[id] & kWaiting) != 0) {
    if (changed) waiting[id] |= kAskedByItself;
    return;
  }
  const PointNow point = {context.evaluation.approach, storedScore(context.points.points, id), now};
  const Due due = dueAfterChange(point, before, changed, FlipsOfPoint{context, id});
  if (due.kind == DueKind::Nothing) return;
  if (due.kind == DueKind::Confirm) {
    confirm(context.points.points, context.evaluation.rule, id, due);
  } else if (waiting != nullptr) {
    waiting[id] |= due.evidence != 0 ? kAsked | kAskedByItself : kAsked;
  } else {
    append(context, id, due);
  }
}

/// @tparam kChooses  whether points may be beside the surface: their normals are all zero, and differ in their signs
template <bool kChooses>
__global__ void storeNeighbours(PointsView points, PointChunk part, FoundNeighbourhood* neighbourhoods,
                                std::uint32_t* changed_bits) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= part.count) return;
  const std::uint32_t id = part.ids[part.first + n];
  FoundNeighbourhood& found = neighbourhoods[n];
  const PointDirections before = directionsOf(points.points, id);
  PointDirections now;
  for (std::size_t axis = 0; axis < 3; ++axis) now.normal[axis] = found.normal[axis];
  now.seen = found.seen;
  const bool is_first = points.state.reach_m[id] < 0;
  const float reach_m = found.reach_m;
  points.state.reach_m[id] = reach_m;
  if (is_first) points.groups.with_points[points.groupOf(id)] = 1;
  // Non-negative floats order like their bits, and -1 orders below them.
  atomicMax(reinterpret_cast<int*>(points.index.reach_m + points.state.block[id]), __float_as_int(reach_m));
  bool changed = is_first;
  for (int axis = 0; axis < 3; ++axis) changed = changed || before.normal[axis] != now.normal[axis];
  if constexpr (kChooses) {
    changed = changed || besideSurfaceAxis(before.normal) != besideSurfaceAxis(now.normal);
  }
  for (int w = 0; w < kMaxDirectionWords; ++w) changed = changed || before.seen.word[w] != now.seen.word[w];
  if (!changed) return;
  atomicOr(changed_bits + (id >> 5), 1u << (id & 31));
  for (std::size_t axis = 0; axis < 3; ++axis) points.points.normal_L[3 * std::size_t{id} + axis] = now.normal[axis];
  const auto words = static_cast<std::size_t>(points.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) points.points.seen[id * words + w] = now.seen.word[w];
  for (std::size_t axis = 0; axis < 3; ++axis) found.normal[axis] = before.normal[axis];
  found.seen = before.seen;
}

__global__ void dueAfterMoves(DueContext context, PointChunk part, const FoundNeighbourhood* all_before,
                              const std::uint32_t* changed_bits) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= part.count) return;
  const std::uint32_t id = part.ids[part.first + n];
  if (!isSet(changed_bits, id)) return;
  PointDirections before;
  for (std::size_t axis = 0; axis < 3; ++axis) before.normal[axis] = all_before[n].normal[axis];
  before.seen = all_before[n].seen;
  takeDue(context, id, before, directionsOf(context.points.points, id), true);
}

/// Calls visit(whether flips may matter to it, its place in the block) with one point of a block per lane, unless what
/// is due there has been decided. All lanes. @param changed_bits  points where it has
template <class Visit>
__device__ void forEachNearFlips(const DueContext& context, std::uint32_t block, const std::uint32_t* changed_bits,
                                 std::uint32_t lane, const Visit& visit) {
  const PointsView& points = context.points;
  const std::uint32_t group = points.groups.of_block[block];
  if (context.masks.affected[group] == 0) return;
  const bool better_arm = any(context.masks.masks[group].better_arm);
  const std::uint32_t* const ids = points.index.ids + points.index.first[block];
  const std::uint32_t count = points.index.count[block];
  for (std::uint32_t first = 0; first < count; first += kWarp) {
    const std::uint32_t n = first + lane, id = n < count ? ids[n] : kNoIndex;
    const bool matters = id != kNoIndex && points.points.label[id] != PointLabel::Unscored &&
                         !isSet(changed_bits, id) &&
                         (better_arm || toolMatters(context, id) || FlipsOfPoint{context, id}.bestArmMayBeBlocked());
    visit(matters, n);
  }
}

/// One warp per block of points.
__global__ void placeFlipped(DueContext context, const std::uint32_t* changed_bits) {
  const std::uint32_t block = blockIdx.x * kWarps + threadIdx.x / kWarp, lane = threadIdx.x % kWarp;
  if (block >= context.points.index.blocks) return;
  std::uint32_t count = 0;
  forEachNearFlips(context, block, changed_bits, lane,
                   [&](bool matters, std::uint32_t /*n*/) { count += __popc(__ballot_sync(kAllLanes, matters)); });
  if (lane == 0) context.due.place[block] = count > 0 ? atomicAdd(&context.due.counters->near_flips, count) : kNoIndex;
}

/// One warp per block of points: they lie side by side, and read the same masks.
__global__ void __launch_bounds__(kThreads)
    dueByFlips(DueContext context, std::uint32_t first, std::uint32_t count, const std::uint32_t* changed_bits) {
  __shared__ std::uint16_t all_places[kWarps][kMostInBlock];
  const std::uint32_t block = blockIdx.x * kWarps + threadIdx.x / kWarp, lane = threadIdx.x % kWarp;
  const PointsView& points = context.points;
  if (block >= points.index.blocks || context.due.place[block] - first >= count) return;
  std::uint16_t* const places = all_places[threadIdx.x / kWarp];
  std::uint32_t listed = 0;
  forEachNearFlips(context, block, changed_bits, lane, [&](bool matters, std::uint32_t n) {
    const unsigned all = __ballot_sync(kAllLanes, matters);
    if (matters) places[listed + __popc(all & ((1u << lane) - 1u))] = static_cast<std::uint16_t>(n);
    listed += __popc(all);
  });
  __syncwarp();
  for (std::uint32_t n = lane; n < listed; n += kWarp) {
    const std::uint32_t id = points.index.ids[points.index.first[block] + places[n]];
    const PointDirections now = directionsOf(points.points, id);
    takeDue(context, id, now, now, false);
  }
}

__global__ void afterWaiting(DueContext context, DeviceList<std::uint32_t> ids) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= ids.count) return;
  const std::uint32_t id = ids.data[n];
  const bool evidence = (context.due.waiting[id] & kAskedByItself) != 0;
  context.due.waiting[id] = 0;
  const PointDirections now = directionsOf(context.points.points, id);
  const PointNow point = {context.evaluation.approach, storedScore(context.points.points, id), now};
  append(context, id, dueAfterWaiting(point, evidence, FlipsOfPoint{context, id}));
}

}  // namespace

void launchStoreNeighbours(const PointsView& points, const PointChunk& part, FoundNeighbourhood* neighbourhoods,
                           std::uint32_t* changed_bits, bool chooses, cudaStream_t stream) {
  if (part.count == 0) return;
  const auto launch = chooses ? storeNeighbours<true> : storeNeighbours<false>;
  launch<<<blocksFor(part.count), kThreads, 0, stream>>>(points, part, neighbourhoods, changed_bits);
  checkLaunch("storeNeighbours");
}

void launchDueAfterMoves(const DueContext& context, const PointChunk& part, const FoundNeighbourhood* before,
                         const std::uint32_t* changed_bits, cudaStream_t stream) {
  if (part.count == 0) return;
  dueAfterMoves<<<blocksFor(part.count), kThreads, 0, stream>>>(context, part, before, changed_bits);
  checkLaunch("dueAfterMoves");
}

void launchPlaceFlipped(const DueContext& context, const std::uint32_t* changed_bits, cudaStream_t stream) {
  if (context.points.index.blocks == 0) return;
  placeFlipped<<<blocksFor(std::uint64_t{context.points.index.blocks} * kWarp), kThreads, 0, stream>>>(context,
                                                                                                       changed_bits);
  checkLaunch("placeFlipped");
}

void launchDueByFlips(const DueContext& context, std::uint32_t first, std::uint32_t count,
                      const std::uint32_t* changed_bits, cudaStream_t stream) {
  if (count == 0) return;
  const unsigned blocks = blocksFor(std::uint64_t{context.points.index.blocks} * kWarp);
  dueByFlips<<<blocks, kThreads, 0, stream>>>(context, first, count, changed_bits);
  checkLaunch("dueByFlips");
}

void launchDueAfterWaiting(const DueContext& context, DeviceList<std::uint32_t> ids, cudaStream_t stream) {
  if (ids.count == 0) return;
  afterWaiting<<<blocksFor(ids.count), kThreads, 0, stream>>>(context, ids);
  checkLaunch("afterWaiting");
}

}  // namespace accessvdb::kernels
