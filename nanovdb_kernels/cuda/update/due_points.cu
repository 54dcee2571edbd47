// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points have to be evaluated, and which of their directions.
///
/// After an update all is known of a point: an accessible one has its best direction and count, a blocked one no free
/// direction. So only directions that are newly admissible, or that a flip for the better may have changed, can change
/// that; and for the best direction a flip for the worse. Flips are taken leaf by leaf, for groups of blocks: too many
/// directions cost time and change nothing.
#include "cuda/memory/cuda_check.h"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

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

__device__ Admissible admissibleNow(const UpdateView& view, std::size_t id) {
  Admissible now;
  for (std::size_t axis = 0; axis < 3; ++axis) now.normal[axis] = view.points.normal_L[3 * id + axis];
  now.seen = loadMask(view, view.points.seen, id);
  return now;
}

__device__ std::uint32_t groupOf(const UpdateView& view, std::uint32_t id) {
  return view.groups.of_block[view.state.block[id]];
}

__device__ GroupMasks masksOf(const UpdateView& view, std::uint32_t id) {
  if (view.affected == nullptr) return {};
  const std::uint32_t group = groupOf(view, id);
  return view.affected[group] != 0 ? view.masks[group] : GroupMasks{};
}

/// Has the point evaluated in this update.
__device__ void append(const UpdateView& view, const DueItem& item) {
  const std::uint32_t block = view.state.block[item.id];
  const std::uint32_t n = atomicAdd(&view.counters->due, 1u);
  view.due.items[n] = item;
  const std::uint32_t next = atomicExch(view.due.head + block, n);
  view.due.items[n].next = next;
  if (next == kNoIndex) view.due.busy[atomicAdd(&view.counters->busy, 1u)] = block;
}

/// The same, or lets the point wait for its turn; then it is found out anew what is due (appendWaiting).
__device__ void appendOrAsk(const UpdateView& view, const DueItem& item) {
  if (view.waiting == nullptr) {
    append(view, item);
  } else {
    view.waiting[item.id] |= item.evidence != 0 ? kAsked | kAskedByItself : kAsked;
  }
}

/// All directions are in question.
__device__ DueItem fullItem(std::uint32_t id, bool evidence) {
  DueItem item = {};
  item.id = id;
  item.all = 1;
  item.evidence = evidence ? 1 : 0;
  return item;
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
  if (view.waiting != nullptr && (view.waiting[id] & kWaiting) != 0) {
    if (changed) view.waiting[id] |= kAskedByItself;
    return;
  }
  const ApproachView& approach = view.approach;
  const PointLabel label = view.points.label[id];
  const int best = view.points.direction[id];
  if (label == PointLabel::Unscored) {
    if (changed) appendOrAsk(view, fullItem(id, true));
    return;
  }
  const bool has_normal = now.normal[0] != 0 || now.normal[1] != 0 || now.normal[2] != 0;
  const bool has_best = has_normal && best != kNoDirection;
  const float cos_best = has_best ? cosToNormal(approach, best, now.normal) : 0;
  if (!has_best || !now.holds(approach, best, cos_best)) {
    // An accessible point lost its direction; the reason of a blocked one belongs to a direction that is gone.
    if (changed) appendOrAsk(view, fullItem(id, true));
    return;  // not changed: a blocked point without any admissible direction
  }
  const GroupMasks masks = masksOf(view, id);
  const bool accessible = label == PointLabel::Accessible;
  const std::uint16_t score = view.points.score[id];
  const std::uint32_t block = view.state.block[id];
  const float cos_best_before = cosToNormal(approach, best, before.normal);
  DueItem item = {};
  item.id = id;
  item.evidence = changed ? 1 : 0;
  if (accessible) {
    if (masks.worse_arm.test(best)) item.test_best |= kTestArm;
    if (masks.worse_tool.test(best) || (score > 0 && masks.better_tool.test(best))) item.test_best |= kTestTool;
  }
  bool some = false;
#pragma unroll
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    const std::uint64_t better = masks.better_tool.word[w] | masks.better_arm.word[w];
    std::uint64_t asked = now.seen.word[w] & (changed ? ~std::uint64_t{0} : better);
    if (accessible && best >> 6 == w) asked &= ~(std::uint64_t{1} << (best & 63));
    asked = notKnownWorse(view, id, block, w, asked);
    std::uint64_t candidates = 0;
    for (; asked != 0; asked &= asked - 1) {
      const int bit = __ffsll(static_cast<long long>(asked)) - 1, d = 64 * w + bit;
      const float cosine = cosToNormal(approach, d, now.normal);
      if (!now.holds(approach, d, cosine)) continue;
      bool wanted = (better >> bit & 1u) != 0;
      bool is_before = true;  // can it be better than the best one?
      if (accessible) is_before = ranksBefore(cosine, d, cos_best, best);
      if (changed && !wanted) {
        const float cos_before = cosToNormal(approach, d, before.normal);
        wanted = !before.holds(approach, d, cos_before) ||
                 (accessible && is_before && !ranksBefore(cos_before, d, cos_best_before, best));
      }
      if (wanted && (!accessible || is_before || score > 0)) candidates |= std::uint64_t{1} << bit;
    }
    item.candidates.word[w] = candidates;
    some = some || candidates != 0;
  }
  if (some || item.test_best != 0) {
    appendOrAsk(view, item);
  } else if (changed && accessible) {
    confirm(view, id);
  }
}

/// What is due of a point that waited: whatever may have changed in the meantime. What is known of its directions has
/// aged with every update, so those that are known to be worse still are.
__device__ void appendWaiting(const UpdateView& view, std::uint32_t id, const Admissible& now, bool evidence) {
  const ApproachView& approach = view.approach;
  const PointLabel label = view.points.label[id];
  const int best = view.points.direction[id];
  const bool has_normal = now.normal[0] != 0 || now.normal[1] != 0 || now.normal[2] != 0;
  const bool has_best = label != PointLabel::Unscored && has_normal && best != kNoDirection;
  const float cos_best = has_best ? cosToNormal(approach, best, now.normal) : 0;
  if (!has_best || !now.holds(approach, best, cos_best)) {
    append(view, fullItem(id, evidence));
    return;
  }
  const bool accessible = label == PointLabel::Accessible;
  const std::uint16_t score = view.points.score[id];
  const std::uint32_t block = view.state.block[id];
  DueItem item = {};
  item.id = id;
  item.evidence = evidence ? 1 : 0;
  if (accessible) item.test_best = kTestArm | kTestTool;
#pragma unroll
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    std::uint64_t asked = now.seen.word[w], candidates = 0;
    if (accessible && best >> 6 == w) asked &= ~(std::uint64_t{1} << (best & 63));
    asked = notKnownWorse(view, id, block, w, asked);
    for (; asked != 0; asked &= asked - 1) {
      const int bit = __ffsll(static_cast<long long>(asked)) - 1, d = 64 * w + bit;
      const float cosine = cosToNormal(approach, d, now.normal);
      if (!now.holds(approach, d, cosine)) continue;
      if (accessible && score == 0 && !ranksBefore(cosine, d, cos_best, best)) continue;
      candidates |= std::uint64_t{1} << bit;
    }
    item.candidates.word[w] = candidates;
  }
  append(view, item);
}

__global__ void takeNeighbours(UpdateView view, std::uint32_t first, std::uint32_t count,
                               const Neighbourhood* neighbourhoods) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const std::uint32_t id = view.moved[first + n];
  const Neighbourhood& found = neighbourhoods[n];
  const Admissible before = admissibleNow(view, id);
  Admissible now;
  for (std::size_t axis = 0; axis < 3; ++axis) now.normal[axis] = found.normal[axis];
  now.seen = found.seen;
  const bool is_first = view.state.reach_m[id] < 0;
  const float reach_m = found.reach_m;
  view.state.reach_m[id] = reach_m;
  if (is_first) view.groups.with_points[groupOf(view, id)] = 1;
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
  if (view.affected[groupOf(view, id)] == 0 || view.points.label[id] == PointLabel::Unscored) return;
  if ((view.state.changed_bits[id >> 5] >> (id & 31) & 1u) != 0) return;  // evaluated already
  const Admissible now = admissibleNow(view, id);
  appendDue(view, id, now, now, false);
}

__global__ void dueOfWaiting(UpdateView view, const std::uint32_t* ids, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const std::uint32_t id = ids[n];
  const bool evidence = (view.waiting[id] & kAskedByItself) != 0;
  view.waiting[id] = 0;
  appendWaiting(view, id, admissibleNow(view, id), evidence);
}

}  // namespace

void launchTakeNeighbours(const UpdateView& view, std::uint32_t first, std::uint32_t count,
                          const Neighbourhood* neighbourhoods, cudaStream_t stream) {
  if (count == 0) return;
  takeNeighbours<<<blocksFor(count), kThreads, 0, stream>>>(view, first, count, neighbourhoods);
  checkLaunch("takeNeighbours");
}

void launchDueOfWaiting(const UpdateView& view, const std::uint32_t* ids, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  dueOfWaiting<<<blocksFor(count), kThreads, 0, stream>>>(view, ids, count);
  checkLaunch("dueOfWaiting");
}

void launchDueByFlips(const UpdateView& view, std::uint32_t first, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  dueByFlips<<<blocksFor(count), kThreads, 0, stream>>>(view, first, count);
  checkLaunch("dueByFlips");
}

}  // namespace accessvdb::kernels
