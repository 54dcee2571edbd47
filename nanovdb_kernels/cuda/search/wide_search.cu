// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// searchWide (hostdev/wide_search.h) with one block per point, and bit for bit the same result.
///
/// The warps of a block take turns of 32 directions each, in the rule's order, and count the tool in those whose
/// corridor is free. What they find goes into the block's memory together with its place in that order, so that the
/// result does not depend on which warp was faster.
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/score_kernels.h"
#include "cuda/search/search_parts.cuh"
#include "cuda/search/wide_order.cuh"

namespace accessvdb::kernels {
namespace {

/// Blocks that a multiprocessor should hold. This limits the registers, but more warps save more than spilling costs.
constexpr unsigned kBlocks = 12;
/// One column in flight: with so many directions, the best so far ends most counts among the first columns.
constexpr int kTurns = 1;

/// Bits of a direction's place in the order, in keys of which the least or the largest wins.
constexpr int kPlaceBits = 12;
static_assert(kMostWideDirections <= 1 << kPlaceBits);

/// The fewest collisions so far, at the first place that has them.
struct BestKey {
  static constexpr std::uint64_t kNone = ~std::uint64_t{0};
  std::uint64_t key = kNone;

  __device__ static BestKey of(int hits, int place, int roll) {
    return {static_cast<std::uint64_t>(hits) << 32 | static_cast<std::uint64_t>(place) << 8 |
            static_cast<std::uint64_t>(roll)};
  }
  [[nodiscard]] __device__ bool there() const { return key != kNone; }
  [[nodiscard]] __device__ int hits() const { return there() ? static_cast<int>(key >> 32) : kNoScore; }
  [[nodiscard]] __device__ int place() const { return static_cast<int>(key >> 8 & 0xffffu); }
  [[nodiscard]] __device__ int roll() const { return static_cast<int>(key & 0xffu); }
};
/// The corridor that got farthest, at the first place that got as far. 0: none.
struct CorridorKey {
  __device__ static std::uint32_t of(const ArmResult& arm, int place) {
    return static_cast<std::uint32_t>(arm.passed + 1) << (kPlaceBits + 1) |
           static_cast<std::uint32_t>((1 << kPlaceBits) - 1 - place) << 1 | (arm.reason == PointReason::Arm ? 1u : 0u);
  }
  [[nodiscard]] __device__ static int place(std::uint32_t key) {
    return (1 << kPlaceBits) - 1 - static_cast<int>(key >> 1 & ((1u << kPlaceBits) - 1));
  }
  [[nodiscard]] __device__ static PointReason reason(std::uint32_t key) {
    return (key & 1u) != 0 ? PointReason::Arm : PointReason::Unknown;
  }
};

/// What the warps of a block have found, in shared memory.
struct FoundSoFar {
  unsigned long long best;   ///< BestKey
  std::uint32_t corridor;    ///< CorridorKey
  std::uint32_t next_place;  ///< of the next turn
  int known_place;           ///< of the known direction, if a turn came upon it
};

/// What is known of a point's result beforehand.
struct KnownBest {
  int score = kNoScore, direction = kNoDirection, roll = 0;
};

/// What a block searches. @tparam Counter  as for SearchContext
template <class Window, class Counter>
struct WideContext {
  MapAround<Window> around;
  const ApproachView& approach;
  const float* position_L;
  const Counter& counter;
  int limit;  ///< [n_c]
  FoundSoFar& found;
};

/// searchDirections for the directions of a list, with one block. All threads call it and get the same result.
template <class Window, class Counter>
class ListSearch {
 public:
  __device__ ListSearch(const WideContext<Window, Counter>& context, const KnownBest& known)
      : c_(context), known_(known), lane_(WideBlock::lane()) {}

  /// @param order  [count] seen directions in the normal cone, in the order in which they are tried
  __device__ ScoreResult run(const std::uint16_t* order, int count, bool in_cone) {
    if (threadIdx.x == 0) c_.found = {BestKey::kNone, 0, 0, kMostWideDirections};
    __syncthreads();
    while (true) {
      const int first = takeTurn();
      if (first >= count || isDecidedBefore(best(), first)) break;
      const int mine = first + lane_ < count ? order[first + lane_] : -1;
      countNext(first, mine, testCorridors(first, mine));
    }
    if (my_corridor_ != 0) atomicMax(&c_.found.corridor, my_corridor_);
    __syncthreads();
    const ScoreResult result = resultOf(order, count, in_cone);
    __syncthreads();  // all have read
    return result;
  }

 private:
  __device__ int takeTurn() {
    const std::uint32_t first = lane_ == 0 ? atomicAdd(&c_.found.next_place, kWarp) : 0;
    return static_cast<int>(__shfl_sync(kAllLanes, first, 0));
  }
  /// The best of all warps. All lanes call it.
  __device__ BestKey best() {
    const unsigned long long key = lane_ == 0 ? atomicMin(&c_.found.best, BestKey::kNone) : 0;
    return {__shfl_sync(kAllLanes, key, 0)};
  }
  /// The rule stops at a direction without collisions.
  [[nodiscard]] __device__ static bool isDecidedBefore(const BestKey& best, int place) {
    return best.hits() == 0 && best.place() < place;
  }

  /// @param mine  this lane's direction, or -1
  /// @return lanes whose corridor is free, and whose direction is not the known one
  __device__ unsigned testCorridors(int first, int mine) {
    const int place = first + lane_;
    const bool is_known = mine >= 0 && mine == known_.direction, is_tested = mine >= 0 && !is_known;
    ArmResult arm = {0, PointReason::None};
    if (is_tested) {
      arm = testArmThrough(c_.around.window, c_.around.map, c_.approach, mine, c_.position_L,
                           c_.around.inverse_voxel_size);
    }
    if (is_known) {
      c_.found.known_place = place;
      if (known_.score < kNoScore) atomicMin(&c_.found.best, BestKey::of(known_.score, place, known_.roll).key);
    }
    const bool is_blocked = arm.reason != PointReason::None;
    if (is_blocked) my_corridor_ = max(my_corridor_, CorridorKey::of(arm, place));
    return __ballot_sync(kAllLanes, is_tested && !is_blocked);
  }

  /// Counts tool collisions in a turn's free directions, one after the other.
  __device__ void countNext(int first, int mine, unsigned free) {
#pragma unroll 1
    for (; free != 0; free &= free - 1) {
      const int at = __ffs(static_cast<int>(free)) - 1, place = first + at;
      const BestKey so_far = best();
      if (isDecidedBefore(so_far, place)) return;
      const int hits = belowNoScore(c_.counter(__shfl_sync(kAllLanes, mine, at), min(so_far.hits(), known_.score)));
      if (hits > so_far.hits()) continue;
      int roll = 0;
      if constexpr (Counter::kRolls) roll = c_.counter.roll;
      if (lane_ == 0) atomicMin(&c_.found.best, BestKey::of(hits, place, roll).key);
    }
  }

  __device__ ScoreResult resultOf(const std::uint16_t* order, int count, bool in_cone) const {
    ScoreResult result;
    result.scored = 1;
    const BestKey best = {c_.found.best};
    const int reached = best.hits() == 0 ? best.place() + 1 : count;
    result.tests = static_cast<std::uint16_t>(reached - (c_.found.known_place < reached ? 1 : 0));
    if (!in_cone) {
      result.reason = PointReason::Normal;
    } else if (count == 0) {
      result.reason = PointReason::Unseen;
    } else if (best.there()) {
      result.score = static_cast<std::uint16_t>(best.hits());
      result.direction = order[best.place()];
      result.roll = static_cast<std::uint8_t>(best.roll());
      result.reason = best.hits() < c_.limit ? PointReason::None : PointReason::Tool;
    } else if (c_.found.corridor != 0) {
      result.direction = order[CorridorKey::place(c_.found.corridor)];
      result.reason = CorridorKey::reason(c_.found.corridor);
    }
    return result;
  }

  const WideContext<Window, Counter>& c_;
  const KnownBest known_;
  const int lane_;
  std::uint32_t my_corridor_ = 0;
};

/// What an item asks for (ScoreItem::only_direction, or_all), of a point with a normal.
template <class Window, class Counter>
__device__ ScoreResult searchItem(const WideContext<Window, Counter>& context, const ScoreItem& item,
                                  const float* normal_L, const std::uint64_t* seen, const WideScratch& scratch) {
  KnownBest known = {item.known_score, item.known_direction, item.known_roll};
  bool only_one = item.only_direction >= 0;
  std::uint16_t tested = 0;
#pragma unroll 1
  while (true) {
    bool in_cone = false;
    int count = 0;
    if (only_one) {
      const int d = item.only_direction;
      in_cone = cosToNormal(context.approach, d, normal_L) >= context.approach.normal_cos_min;
      count = in_cone && (seen[d >> 6] >> (d & 63) & 1u) != 0 ? 1 : 0;
      if (threadIdx.x == 0 && count > 0) scratch.order[0] = static_cast<std::uint16_t>(d);
    } else {
      count = WideOrder(context.approach, normal_L, scratch).make(seen, in_cone);
    }
    ScoreResult found = ListSearch<Window, Counter>(context, known).run(scratch.order, count, in_cone);
    found.tests = static_cast<std::uint16_t>(found.tests + tested);
    const bool suffices = found.reason == PointReason::None && found.score <= item.known_score;
    if (!only_one || item.or_all == 0 || suffices) return found;
    tested = found.tests;
    known.score = kNoScore;
    only_one = false;
  }
}

template <class Window, bool kSamples, bool kRolls>
__global__ void __launch_bounds__(WideBlock::kThreads, kBlocks) wideSearch(ScoreChunk chunk, WindowPlan plan) {
  __shared__ FoundSoFar found;
  const SearchedPoint point(chunk, blockIdx.x);
  ScoreResult result;
  const float normal_L[3] = {chunk.points.normal_L[3 * point.id], chunk.points.normal_L[3 * point.id + 1],
                             chunk.points.normal_L[3 * point.id + 2]};
  if (normal_L[0] != 0 || normal_L[1] != 0 || normal_L[2] != 0) {
    const Window window =
        makeWindow<Window>(chunk, point, plan, window_nodes, {WideBlock::thread(), WideBlock::kThreads});
    const MapOutside map(chunk.map);
    const WideScratch scratch(window_nodes + plan.entries());
    const std::uint64_t* seen = chunk.points.seen + point.id * static_cast<std::size_t>(chunk.points.direction_words);
    const auto search = [&](const auto& counter) {
      const WideContext<Window, std::decay_t<decltype(counter)>> context = {{window, map, chunk.map.inverse_voxel_size},
                                                                            chunk.approach,
                                                                            point.position_L,
                                                                            counter,
                                                                            chunk.tool.collision_limit,
                                                                            found};
      return searchItem(context, chunk.items[point.item], normal_L, seen, scratch);
    };
    const auto of_part = partCounter<kSamples, kTurns>(chunk, window, map, point, WideBlock::lane());
    if constexpr (kRolls) {
      result = search(RollCounter<std::decay_t<decltype(of_part)>, true>{of_part, chunk.tool.parts});
    } else {
      result = search(of_part);
    }
  }
  if (threadIdx.x == 0) chunk.results[point.item] = result;
}

template <class Window>
void allowShared(int shared_bytes_per_block) {
  for (const void* kernel : {reinterpret_cast<const void*>(&wideSearch<Window, false, false>),
                             reinterpret_cast<const void*>(&wideSearch<Window, true, false>),
                             reinterpret_cast<const void*>(&wideSearch<Window, false, true>),
                             reinterpret_cast<const void*>(&wideSearch<Window, true, true>)}) {
    allowAllShared(kernel, shared_bytes_per_block);
  }
}

}  // namespace

void allowWideSearch(int shared_bytes_per_block) {
  allowShared<WindowReader<LeafWindow>>(shared_bytes_per_block);
  allowShared<WindowReader<LowerWindow>>(shared_bytes_per_block);
  allowShared<TreeWindow>(shared_bytes_per_block);
}

void launchWideSearch(const ScoreChunk& chunk, WindowPlan plan, int shared_bytes_per_block, cudaStream_t stream) {
  if (chunk.count == 0) return;
  const auto list_bytes =
      static_cast<std::uint32_t>(WideScratch::words(chunk.approach.num_directions) * sizeof(std::uint32_t));
  if (plan.entries() * sizeof(std::uint32_t) + list_bytes + sizeof(FoundSoFar) >
      static_cast<std::size_t>(shared_bytes_per_block)) {
    plan = {};
  }
  launchByForm(chunk.tool, [&](auto samples, auto rolls) {
    constexpr bool kSamples = decltype(samples)::value, kRolls = decltype(rolls)::value;
    launchSearch(chunk, plan, {1, WideBlock::kWarps, list_bytes, stream},
                 wideSearch<WindowReader<LeafWindow>, kSamples, kRolls>,
                 wideSearch<WindowReader<LowerWindow>, kSamples, kRolls>, wideSearch<TreeWindow, kSamples, kRolls>);
  });
  checkLaunch("wideSearch");
}

}  // namespace accessvdb::kernels
