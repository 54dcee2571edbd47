// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// searchWide (hostdev/wide_search.h) with one warp per point, and bit for bit the same result.
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/score_kernels.h"
#include "cuda/search/search_parts.cuh"
#include "cuda/search/wide_order.cuh"

namespace accessvdb::kernels {
namespace {

/// Per block. One: points differ so much that a block would wait for the slowest of its own.
constexpr unsigned kWarps = 1;
/// Blocks that a multiprocessor should hold: this limits the registers.
constexpr unsigned kBlocks = 32;
/// One column in flight: with so many directions, the best so far ends most counts among the first columns.
constexpr int kTurns = 1;

/// What is known of a point's result beforehand.
struct KnownBest {
  int score = kNoScore, direction = kNoDirection, roll = 0;
};

/// What a warp searches. @tparam Counter  as for SearchContext
template <class Window, class Counter>
struct WideContext {
  MapAround<Window> around;
  const ApproachView& approach;
  const float* position_L;
  const Counter& counter;
  int limit;  ///< [n_c]
  int lane;
};

/// searchDirections for the directions of a list, with one warp. All lanes call it and get the same result.
template <class Window, class Counter>
class ListSearch {
 public:
  __device__ ListSearch(const WideContext<Window, Counter>& context, const KnownBest& known)
      : c_(context), known_(known) {}

  /// @param order  [count] seen directions in the normal cone, in the order in which they are tried
  __device__ ScoreResult run(const std::uint16_t* order, int count, bool in_cone) {
    ScoreResult result;
    result.scored = 1;
    bool done = false;
#pragma unroll 1
    for (int first = 0; first < count && !done; first += static_cast<int>(kWarp)) {
      const int mine = first + c_.lane < count ? order[first + c_.lane] : -1;
      const Turn turn = testCorridors(mine, result);
      const unsigned upto = countNext(turn, done, result);
      result.tests = static_cast<std::uint16_t>(result.tests + __popc((turn.blocked | turn.free) & upto));
    }
    if (!in_cone) {
      result.reason = PointReason::Normal;
    } else if (count == 0) {
      result.reason = PointReason::Unseen;
    } else if (best_count_ != kNoScore) {
      result.score = static_cast<std::uint16_t>(best_count_);
      result.reason = best_count_ < c_.limit ? PointReason::None : PointReason::Tool;
    }
    return result;
  }

 private:
  /// Up to 32 directions at a time, one per lane.
  struct Turn {
    int mine;                       ///< this lane's direction, or -1
    unsigned known, blocked, free;  ///< masks of lanes, by state of their directions
  };

  __device__ Turn testCorridors(int mine, ScoreResult& result) {
    Turn turn = {mine, 0, 0, 0};
    const bool is_known = mine >= 0 && mine == known_.direction, is_tested = mine >= 0 && !is_known;
    ArmResult arm = {0, PointReason::None};
    if (is_tested) {
      arm = testArmThrough(c_.around.window, c_.around.map, c_.approach, mine, c_.position_L,
                           c_.around.inverse_voxel_size);
    }
    const bool is_blocked = arm.reason != PointReason::None;
    turn.known = __ballot_sync(kAllLanes, is_known);
    turn.blocked = __ballot_sync(kAllLanes, is_blocked);
    turn.free = __ballot_sync(kAllLanes, is_tested && !is_blocked);

    // A corridor is the closest outcome only as long as no direction has got as far as the tool.
    const unsigned scored = turn.free | (known_.score < kNoScore ? turn.known : 0u);
    const unsigned before_scored = scored == 0 ? kAllLanes : (scored & (0u - scored)) - 1;
    if (!tool_reached_ && (turn.blocked & before_scored) != 0) {
      const bool counts = is_blocked && (before_scored >> c_.lane & 1u) != 0;
      const int most = __reduce_max_sync(kAllLanes, counts ? arm.passed : -1);
      if (most > best_passed_) {
        const int closest = __ffs(static_cast<int>(__ballot_sync(kAllLanes, counts && arm.passed == most))) - 1;
        best_passed_ = most;
        result.reason = static_cast<PointReason>(__shfl_sync(kAllLanes, static_cast<int>(arm.reason), closest));
        result.direction = static_cast<std::uint16_t>(__shfl_sync(kAllLanes, mine, closest));
      }
    }
    tool_reached_ = tool_reached_ || scored != 0;
    return turn;
  }

  /// Counts tool collisions in a turn's free directions, one after the other.
  /// @param done  set if a direction without any collision was found
  /// @return lanes whose directions the rule reaches
  __device__ unsigned countNext(const Turn& turn, bool& done, ScoreResult& result) {
#pragma unroll 1
    for (unsigned events = turn.known | turn.free; events != 0; events &= events - 1) {
      const int at = __ffs(static_cast<int>(events)) - 1;
      const int d = __shfl_sync(kAllLanes, turn.mine, at);
      if ((turn.known >> at & 1u) != 0) {
        takeIfLess(known_.score, d, known_.roll, result);
      } else {
        const int hits = belowNoScore(c_.counter(d, min(best_count_, known_.score)));
        if (hits >= c_.limit && hits < result.least_blocked) result.least_blocked = static_cast<std::uint16_t>(hits);
        int roll = 0;
        if constexpr (Counter::kRolls) roll = c_.counter.roll;
        takeIfLess(hits, d, roll, result);
      }
      if (best_count_ == 0) {
        done = true;
        return (2u << at) - 1;
      }
    }
    return kAllLanes;
  }

  __device__ void takeIfLess(int hits, int d, int roll, ScoreResult& result) {
    if (hits >= best_count_) return;
    best_count_ = hits;
    result.direction = static_cast<std::uint16_t>(d);
    result.roll = static_cast<std::uint8_t>(roll);
  }

  const WideContext<Window, Counter>& c_;
  const KnownBest known_;
  int best_count_ = kNoScore, best_passed_ = -1;
  bool tool_reached_ = false;
};

/// What an item asks for (ScoreItem::only_direction, or_all), of a point with a normal.
template <class Window, class Counter>
__device__ ScoreResult searchItem(const WideContext<Window, Counter>& context, const ScoreItem& item,
                                  const float* normal_L, const std::uint64_t* seen, const WideScratch& scratch) {
  KnownBest known = {item.known_score, item.known_direction, item.known_roll};
  std::uint16_t tested = 0;
  if (item.only_direction >= 0) {
    const int d = item.only_direction;
    const bool in_cone = cosToNormal(context.approach, d, normal_L) >= context.approach.normal_cos_min;
    const bool wanted = in_cone && (seen[d >> 6] >> (d & 63) & 1u) != 0;
    if (context.lane == 0 && wanted) scratch.order[0] = static_cast<std::uint16_t>(d);
    __syncwarp();
    const ScoreResult found = ListSearch<Window, Counter>(context, known).run(scratch.order, wanted ? 1 : 0, in_cone);
    __syncwarp();  // all have read the list
    if (item.or_all == 0 || (found.reason == PointReason::None && found.score <= item.known_score)) return found;
    tested = found.tests;
    known.score = kNoScore;
  }
  bool in_cone = false;
  const int count = WideOrder(context.approach, normal_L, scratch, context.lane).make(seen, in_cone);
  ScoreResult found = ListSearch<Window, Counter>(context, known).run(scratch.order, count, in_cone);
  found.tests = static_cast<std::uint16_t>(found.tests + tested);
  return found;
}

template <class Window, bool kSamples, bool kRolls>
__global__ void __launch_bounds__(kWarps* kWarp, kBlocks) wideSearch(ScoreChunk chunk, WindowPlan plan) {
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  const WarpPoint point(chunk, kWarps);
  if (!point.there) return;
  const Window window = makeWindow<Window>(chunk, point, plan, lane);
  const int directions = chunk.approach.num_directions;
  const WideScratch scratch(window_nodes + kWarps * plan.entries() +
                            threadIdx.x / kWarp * WideScratch::words(directions));
  const OccupancyReader map(chunk.map);
  const float normal_L[3] = {chunk.points.normal_L[3 * point.id], chunk.points.normal_L[3 * point.id + 1],
                             chunk.points.normal_L[3 * point.id + 2]};
  ScoreResult result;
  if (normal_L[0] != 0 || normal_L[1] != 0 || normal_L[2] != 0) {
    const std::uint64_t* seen = chunk.points.seen + point.id * static_cast<std::size_t>(chunk.points.direction_words);
    const auto search = [&](const auto& counter) {
      const WideContext<Window, std::decay_t<decltype(counter)>> context = {{window, map, chunk.map.inverse_voxel_size},
                                                                            chunk.approach,
                                                                            point.position_L,
                                                                            counter,
                                                                            chunk.tool.collision_limit,
                                                                            lane};
      return searchItem(context, chunk.items[point.item], normal_L, seen, scratch);
    };
    const auto of_part = partCounter<kSamples, kTurns>(chunk, window, map, point, lane);
    if constexpr (kRolls) {
      result = search(RollCounter<std::decay_t<decltype(of_part)>, true>{of_part, chunk.tool.parts});
    } else {
      result = search(of_part);
    }
  }
  if (lane == 0) chunk.results[point.item] = result;
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
  allowShared<MapWindow<LeafWindow>>(shared_bytes_per_block);
  allowShared<MapWindow<LowerWindow>>(shared_bytes_per_block);
  allowShared<TreeWindow>(shared_bytes_per_block);
}

void launchWideSearch(const ScoreChunk& chunk, WindowPlan plan, int shared_bytes_per_block, cudaStream_t stream) {
  if (chunk.count == 0) return;
  const auto list_bytes =
      static_cast<std::uint32_t>(WideScratch::words(chunk.approach.num_directions) * sizeof(std::uint32_t));
  if (kWarps * (plan.entries() * sizeof(std::uint32_t) + list_bytes) >
      static_cast<std::size_t>(shared_bytes_per_block)) {
    plan = {};
  }
  const auto launch = [&](auto samples, auto rolls) {
    constexpr bool kSamples = decltype(samples)::value, kRolls = decltype(rolls)::value;
    launchWarps(chunk, plan, {kWarps, list_bytes, stream}, wideSearch<MapWindow<LeafWindow>, kSamples, kRolls>,
                wideSearch<MapWindow<LowerWindow>, kSamples, kRolls>, wideSearch<TreeWindow, kSamples, kRolls>);
  };
  const auto launchForm = [&](auto samples) {
    chunk.tool.parts > 1 ? launch(samples, std::true_type()) : launch(samples, std::false_type());
  };
  chunk.tool.use_samples ? launchForm(std::true_type()) : launchForm(std::false_type());
  checkLaunch("wideSearch");
}

}  // namespace accessvdb::kernels
