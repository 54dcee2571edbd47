// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points have to be evaluated, and which of their directions.
///
/// After an update all is known of a point: an accessible one has its best direction and count, a blocked one no free
/// direction. So only directions that are newly admissible, or that a flip for the better may have changed, can change
/// that; and for the best direction a flip for the worse. Flips are taken leaf by leaf: too many directions cost time
/// and change nothing.
#include "cuda/cuda_check.h"
#include "cuda/known_collisions.cuh"
#include "cuda/update_kernels.h"
#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256, kLanes = 32;
constexpr unsigned kAll = 0xffffffffu;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__device__ bool anyOf(const DirectionMask& mask) {
  return (mask.word[0] | mask.word[1] | mask.word[2] | mask.word[3]) != 0;
}

__global__ void addFlips(UpdateView view, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const LeafFlips& flip = view.flips.list[n];
  const std::uint32_t slot = view.flips.hash.insert(placeKey(flip.leaf[0], flip.leaf[1], flip.leaf[2] >> 4));
  std::uint64_t bits = 0;
  for (int kind = 0; kind < 4; ++kind) {
    if ((flip.kinds >> kind & 1u) != 0) bits |= std::uint64_t{1} << (16 * kind + (flip.leaf[2] & 15));
  }
  atomicOr(reinterpret_cast<unsigned long long*>(view.flips.kinds + slot), static_cast<unsigned long long>(bits));
  if (flip.freed != 0) view.flips.next[n] = atomicExch(view.flips.head + slot, n);
}

/// Kinds of flips in a column of leaves, bit as in LeafFlips.
__device__ std::uint32_t kindsIn(const FlipsView& flips, std::int32_t x, std::int32_t y, std::int32_t z_low,
                                 std::int32_t z_high) {
  std::uint32_t kinds = 0;
  for (std::int32_t part = z_low >> 4; part <= z_high >> 4; ++part) {
    const std::uint32_t slot = flips.hash.find(placeKey(x, y, part));
    if (slot == kNoIndex) continue;
    const std::int32_t from = z_low - part * 16, to = z_high - part * 16;
    const std::uint32_t wanted = (0xffffu << (from > 0 ? from : 0)) & (0xffffu >> (to < 15 ? 15 - to : 0));
    const std::uint64_t bits = flips.kinds[slot];
    for (int kind = 0; kind < 4; ++kind) {
      if ((static_cast<std::uint32_t>(bits >> (16 * kind)) & wanted) != 0) kinds |= 1u << kind;
    }
  }
  return kinds;
}

__device__ void freedIn(const UpdateView& view, const std::int32_t* leaf, const FootprintColumn& c,
                        std::uint32_t* steps) {
  const std::int32_t z_low = leaf[2] + c.z_low, z_high = leaf[2] + c.z_high;
  for (std::int32_t part = z_low >> 4; part <= z_high >> 4; ++part) {
    const std::uint32_t slot = view.flips.hash.find(placeKey(leaf[0] + c.dx, leaf[1] + c.dy, part));
    if (slot != kNoIndex) countFreed(view, leaf, slot, z_low, z_high, steps);
  }
}

__device__ void orInto(DirectionMask& into, const DirectionMask& from) {
  for (int w = 0; w < kMaxDirectionWords; ++w) into.word[w] |= from.word[w];
}

__device__ void orOfWarp(DirectionMask& mask) {
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    const auto low = __reduce_or_sync(kAll, static_cast<unsigned>(mask.word[w]));
    const auto high = __reduce_or_sync(kAll, static_cast<unsigned>(mask.word[w] >> 32));
    mask.word[w] = static_cast<std::uint64_t>(high) << 32 | low;
  }
}

__device__ void orOfWarp(BlockMasks& masks) {
  for (DirectionMask* mask : {&masks.better_tool, &masks.better_arm, &masks.worse_tool, &masks.worse_arm}) {
    orOfWarp(*mask);
  }
}

/// Directions of a footprint with flips in their leaves, a column a lane. @param steps  see countFreed; null: not
/// wanted
__device__ void scanFootprint(const UpdateView& view, const std::int32_t* leaf, const FootprintColumn* columns,
                              std::uint32_t count, std::uint32_t better_kind, std::uint32_t worse_kind,
                              DirectionMask& better, DirectionMask& worse, std::uint32_t* steps) {
  for (std::uint32_t n = threadIdx.x % kLanes; n < count; n += kLanes) {
    const FootprintColumn& c = columns[n];
    const std::uint32_t kinds =
        kindsIn(view.flips, leaf[0] + c.dx, leaf[1] + c.dy, leaf[2] + c.z_low, leaf[2] + c.z_high);
    if ((kinds & better_kind) != 0) {
      orInto(better, c.directions);
      if (steps != nullptr) freedIn(view, leaf, c, steps);
    }
    if ((kinds & worse_kind) != 0) orInto(worse, c.directions);
  }
}

/// A warp a block.
__global__ void blockMasks(UpdateView view) {
  __shared__ std::uint32_t all_steps[kThreads / kLanes][32 * kDirectionWords32];
  const std::uint32_t block = (blockIdx.x * kThreads + threadIdx.x) / kLanes;
  if (block >= view.index.blocks) return;
  const int lane = static_cast<int>(threadIdx.x % kLanes);
  std::uint32_t* steps = view.known.levels != nullptr ? all_steps[threadIdx.x / kLanes] : nullptr;
  if (steps != nullptr) {
    for (int n = lane; n < 32 * kDirectionWords32; n += static_cast<int>(kLanes)) steps[n] = 0;
    __syncwarp();
  }
  BlockMasks masks = {};
  if (view.index.reach_m[block] >= 0) {
    const std::int32_t* leaf = view.index.leaf + 3 * static_cast<std::size_t>(block);
    scanFootprint(view, leaf, view.footprint.tool, view.footprint.tool_count, 2, 1, masks.better_tool, masks.worse_tool,
                  steps);
    scanFootprint(view, leaf, view.footprint.arm, view.footprint.arm_count, 4, 8, masks.better_arm, masks.worse_arm,
                  nullptr);
  }
  __syncwarp();
  orOfWarp(masks);
  if (steps != nullptr && (anyOf(masks.better_tool) || anyOf(masks.better_arm))) {
    agePoints(view, block, steps, masks.better_arm, lane);
  }
  if (lane != 0) return;
  view.masks[block] = masks;
  view.affected[block] =
      anyOf(masks.better_tool) || anyOf(masks.better_arm) || anyOf(masks.worse_tool) || anyOf(masks.worse_arm) ? 1 : 0;
}

/// A point's directions under a normal and a set of seen ones.
struct Admissible {
  float normal[3];
  DirectionMask seen;

  __device__ bool holds(const ApproachView& approach, int d, float cosine) const {
    return seen.test(d) && cosine >= approach.normal_cos_min;
  }
};

__device__ DirectionMask loadMask(const UpdateView& view, const std::uint64_t* masks, std::size_t id) {
  DirectionMask mask = {};
  const auto words = static_cast<std::size_t>(view.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) mask.word[w] = masks[id * words + w];
  return mask;
}

__device__ BlockMasks masksOf(const UpdateView& view, std::uint32_t id) {
  if (view.affected == nullptr) return {};
  const std::uint32_t block = view.state.block[id];
  return view.affected[block] != 0 ? view.masks[block] : BlockMasks{};
}

__device__ void append(const UpdateView& view, const DueItem& item) {
  const std::uint32_t block = view.state.block[item.id];
  const std::uint32_t n = atomicAdd(&view.counters->due, 1u);
  view.due.items[n] = item;
  const std::uint32_t next = atomicExch(view.due.head + block, n);
  view.due.items[n].next = next;
  if (next == kNoIndex) view.due.busy[atomicAdd(&view.counters->busy, 1u)] = block;
}

__device__ void appendFull(const UpdateView& view, std::uint32_t id) {
  DueItem item = {};
  item.id = id;
  item.all = 1;
  item.evidence = 1;
  append(view, item);
}

/// An accessible point whose best direction is still the best one: nothing to test.
__device__ void confirm(const UpdateView& view, std::uint32_t id) {
  ScoreItem item;
  item.id = id;
  ScoreResult result;
  result.scored = 1;
  result.score = view.points.score[id];
  result.direction = view.points.direction[id];
  result.reason = PointReason::None;
  updatePoint(view.points, item, result, view.update_rule);
}

/// What is due of a point. @param before  as it was at the last update; equal to `now` where nothing of it changed
/// @param changed  before != now: evaluated in any case
__device__ void appendDue(const UpdateView& view, std::uint32_t id, const Admissible& before, const Admissible& now,
                          bool changed) {
  const ApproachView& approach = view.approach;
  const PointLabel label = view.points.label[id];
  const int best = view.points.direction[id];
  if (label == PointLabel::Unscored) {
    if (changed) appendFull(view, id);
    return;
  }
  const bool has_normal = now.normal[0] != 0 || now.normal[1] != 0 || now.normal[2] != 0;
  const bool has_best = has_normal && best != kNoDirection;
  const float cos_best = has_best ? cosToNormal(approach, best, now.normal) : 0;
  if (!has_best || !now.holds(approach, best, cos_best)) {
    // An accessible point lost its direction; the reason of a blocked one belongs to a direction that is gone.
    if (changed) appendFull(view, id);
    return;  // not changed: a blocked point without any admissible direction
  }
  const BlockMasks masks = masksOf(view, id);
  const bool accessible = label == PointLabel::Accessible;
  const std::uint16_t score = view.points.score[id];
  const DirectionMask worse = knownWorse(view, id, view.state.block[id],
                                         accessible ? score + 1 : static_cast<int>(view.update_rule.collision_limit));
  const float cos_best_before = cosToNormal(approach, best, before.normal);
  DueItem item = {};
  item.id = id;
  item.evidence = changed ? 1 : 0;
  if (accessible) {
    if (masks.worse_arm.test(best)) item.test_best |= kTestArm;
    if (masks.worse_tool.test(best) || (score > 0 && masks.better_tool.test(best))) item.test_best |= kTestTool;
  }
  bool some = false;
  for (int d = 0; d < approach.num_directions; ++d) {
    const bool better = masks.better_tool.test(d) || masks.better_arm.test(d);
    if (!changed && !better) continue;
    if ((accessible && d == best) || !now.seen.test(d) || worse.test(d)) continue;
    const float cosine = cosToNormal(approach, d, now.normal);
    if (!now.holds(approach, d, cosine)) continue;
    bool wanted = better;
    bool is_before = true;  // can it be better than the best one?
    if (accessible) is_before = ranksBefore(cosine, d, cos_best, best);
    if (changed && !wanted) {
      const float cos_before = cosToNormal(approach, d, before.normal);
      wanted = !before.holds(approach, d, cos_before) ||
               (accessible && is_before && !ranksBefore(cos_before, d, cos_best_before, best));
    }
    if (wanted && (!accessible || is_before || score > 0)) {
      item.candidates.set(d);
      some = true;
    }
  }
  if (some || item.test_best != 0) {
    append(view, item);
  } else if (changed && accessible) {
    confirm(view, id);
  }
}

__global__ void takeNeighbours(UpdateView view, std::uint32_t first, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const std::uint32_t id = view.moved[first + n];
  const FoundNeighbours& found = view.found[n];
  Admissible before, now;
  for (std::size_t axis = 0; axis < 3; ++axis) before.normal[axis] = view.points.normal_L[3 * std::size_t{id} + axis];
  before.seen = loadMask(view, view.points.seen, id);
  neighbourNormal(found.sums, view.state.to_sensor_L + 3 * std::size_t{id}, now.normal);
  now.seen = found.seen;
  const bool is_first = view.state.reach_m[id] < 0;
  const float reach_m = neighbourReach_m(found.farthest, view.rule.steps_per_m);
  view.state.reach_m[id] = reach_m;
  // Floats that are not negative are in the order of their bits, and -1 is below them.
  atomicMax(reinterpret_cast<int*>(view.index.reach_m + view.state.block[id]), __float_as_int(reach_m));
  bool changed = is_first;
  for (int axis = 0; axis < 3; ++axis) changed = changed || before.normal[axis] != now.normal[axis];
  for (int w = 0; w < kMaxDirectionWords; ++w) changed = changed || before.seen.word[w] != now.seen.word[w];
  if (!changed) return;
  atomicOr(view.state.changed_bits + (id >> 5), 1u << (id & 31));
  for (std::size_t axis = 0; axis < 3; ++axis) view.points.normal_L[3 * std::size_t{id} + axis] = now.normal[axis];
  const auto words = static_cast<std::size_t>(view.points.direction_words);
  for (std::size_t w = 0; w < words; ++w) view.points.seen[id * words + w] = now.seen.word[w];
  appendDue(view, id, before, now, true);
}

__global__ void dueByFlips(UpdateView view, std::uint32_t first, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const std::uint32_t id = first + n;
  if (view.affected[view.state.block[id]] == 0 || view.points.label[id] == PointLabel::Unscored) return;
  if ((view.state.changed_bits[id >> 5] >> (id & 31) & 1u) != 0) return;  // evaluated already
  Admissible now;
  for (std::size_t axis = 0; axis < 3; ++axis) now.normal[axis] = view.points.normal_L[3 * std::size_t{id} + axis];
  now.seen = loadMask(view, view.points.seen, id);
  appendDue(view, id, now, now, false);
}

}  // namespace

void launchAddFlips(const UpdateView& view, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  addFlips<<<blocksFor(count), kThreads, 0, stream>>>(view, count);
  checkLaunch("addFlips");
}

void launchBlockMasks(const UpdateView& view, cudaStream_t stream) {
  if (view.index.blocks == 0) return;
  blockMasks<<<blocksFor(std::uint64_t{view.index.blocks} * kLanes), kThreads, 0, stream>>>(view);
  checkLaunch("blockMasks");
}

void launchTakeNeighbours(const UpdateView& view, std::uint32_t first, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  takeNeighbours<<<blocksFor(count), kThreads, 0, stream>>>(view, first, count);
  checkLaunch("takeNeighbours");
}

void launchDueByFlips(const UpdateView& view, std::uint32_t first, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  dueByFlips<<<blocksFor(count), kThreads, 0, stream>>>(view, first, count);
  checkLaunch("dueByFlips");
}

}  // namespace accessvdb::kernels
