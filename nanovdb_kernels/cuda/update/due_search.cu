// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Evaluates what is due, one warp per point: points that need all of their directions, concurrently those with a few
/// directions in question, and last those that the second kind turned into points that need all. Points of a leaf
/// follow each other, so that they find the map they read in the cache.
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/busy_window.cuh"
#include "cuda/search/launch_by_form.h"
#include "cuda/search/warp_search.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/learn.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4, kThreads = kWarps * kWarp;
/// Blocks that a multiprocessor should hold. More gain nothing: warps read much of the map, and evict each other's data
/// from the cache.
constexpr unsigned kBlocksEach = 6;

extern __shared__ std::uint32_t nodes_of_windows[];

/// A warp's shared memory except the nodes of its window.
struct WarpScratch {
  WarpMasks masks;
  ScoreItem item;
  SlabWork slabs;
};
// With the nodes of the windows (kPlainSharedBytes), that is what a block gets without asking.
static_assert(kWarps * sizeof(WarpScratch) <= 10 * 1024);

/// The point that a warp evaluates.
struct DuePoint {
  std::size_t id;
  float position_L[3], normal_L[3];
  const std::uint64_t* seen;
  Coord ijk;

  __device__ DuePoint(const PointStateView& points, std::uint32_t which, float inverse_voxel_size) : id(which) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      position_L[axis] = points.position_L[3 * id + axis];
      normal_L[axis] = points.normal_L[3 * id + axis];
    }
    seen = points.seen + id * static_cast<std::size_t>(points.direction_words);
    ijk = voxelOf(position_L[0], position_L[1], position_L[2], inverse_voxel_size);
  }
};

__device__ std::uint32_t* nodesOfWarp(const DueSearch& search) {
  return nodes_of_windows + threadIdx.x / kWarp * search.window.entries() * BusyWindow::kEntries;
}

template <class Window>
__device__ Window makeDueWindow(const DueSearch& search, const Coord& point_ijk, int lane) {
  if constexpr (std::is_same_v<Window, TreeWindow>) {
    return TreeWindow(search.map);
  } else {
    const Window window(nodesOfWarp(search), search.window.shape, search.map, search.busy, point_ijk, lane);
    __syncwarp();
    return window;
  }
}

/// Sets what slab counting needs and is the same for all points. One lane calls it.
__device__ void prepareSlabs(const DueSearch& search, SlabWork& work) {
  work.tool = search.slabs;
  work.map = search.map;
  work.shape = search.window.shape;
  work.nodes = nodesOfWarp(search);
  work.busy_bits = search.busy.bits;
}

/// Makes a point's collision counter. All lanes call it.
template <class Form, class Window>
__device__ auto makeCounter(const DueSearch& search, const Window& window, const MapOutside& map, const DuePoint& point,
                            WarpScratch& scratch, int lane) {
  if constexpr (Form::rolls) {
    const auto of_part = makeCounter<typename Form::OfPart>(search, window, map, point, scratch, lane);
    return RollCounter<std::decay_t<decltype(of_part)>, false>{of_part, search.tool.parts};
  } else if constexpr (Form::by_slabs) {
    if (lane < 3) scratch.slabs.in_window[lane] = window.fromCorner(point.ijk, lane);
    __syncwarp();
    return SlabCounter<Form::thick, Form::rows>{scratch.slabs, lane};
  } else if constexpr (Form::by_columns) {
    return ColumnCounter<Window>{window, search.tool, point.ijk, lane};
  } else {
    return SampleCounter<Window>{window, map, search.tool, point.position_L, search.map.inverse_voxel_size, lane};
  }
}

/// Takes the next number of a counter, the same for all lanes.
__device__ std::uint32_t takeNext(std::uint32_t* next, int lane) {
  std::uint32_t n = 0;
  if (lane == 0) n = atomicAdd(next, 1u);
  return __shfl_sync(kAllLanes, n, 0);
}

/// What is known about a point's directions, for a search.
struct KnownOfPoint {
  const DueWork& work;
  std::size_t id;
  int base;  ///< what the levels count from
  __device__ int operator()(int d) const { return knownCollisions(work.points, work.evaluation.known, id, base, d); }
};

/// Applies a result to its point. One lane calls it.
/// @return what the point's levels count from now
__device__ int conclude(const DueWork& work, const ScoreItem& item, ScoreResult& result) {
  const PointStateView& points = work.points.points;
  const UpdateRule& rule = work.evaluation.rule;
  const PointLabel before = points.label[item.id];
  updatePoint(points, item, result, rule);
  OutcomeCounters& counters = *work.outcome;
  atomicAdd(&counters.evaluated, 1ull);
  if (result.tests > 0) {
    atomicAdd(&counters.tests, static_cast<unsigned long long>(result.tests));
    atomicAdd(&counters.scored, 1ull);
  }
  if (result.label != before) atomicAdd(&counters.label_changes, 1ull);
  return baseCollisions(result.label == PointLabel::Accessible, result.stored_score, rule.collision_limit);
}

/// What the point's levels count from.
__device__ int baseOf(const DueWork& work, std::size_t id) {
  const PointStateView& points = work.points.points;
  return baseCollisions(points.label[id] == PointLabel::Accessible, points.score[id],
                        work.evaluation.rule.collision_limit);
}

/// Stores what was learnt about a point. All lanes call it. @param searched  whether the masks are of this point
__device__ void concludeAndLearn(const DueWork& work, WarpScratch& scratch, bool searched, int base_before,
                                 ScoreResult& result, int lane) {
  __syncwarp();  // all have read what is known about the point
  const ScoreItem& item = scratch.item;
  const int base = lane == 0 ? conclude(work, item, result) : 0;
  learn(work, item.id, scratch.masks, searched, base_before, __shfl_sync(kAllLanes, base, 0), lane);
  __syncwarp();  // the scratch memory it has read is overwritten next
}

/// Tests a direction's corridor, one sample per lane.
template <class Window>
__device__ bool armIsFree(const MapAround<Window>& around, const ApproachView& approach, int d, const float* position_L,
                          int lane) {
  bool free = true;
#pragma unroll 1
  for (int n = lane; n < approach.num_arm; n += static_cast<int>(kWarp)) {
    const float* offset = approach.arm_offsets + 3 * (static_cast<std::int64_t>(d) * approach.num_arm + n);
    const Coord ijk = voxelOf(position_L[0] + offset[0], position_L[1] + offset[1], position_L[2] + offset[2],
                              around.inverse_voxel_size);
    free = free && (around.window.holds(ijk) ? around.window.armFree(ijk) : around.map.armFree(ijk));
  }
  return __all_sync(kAllLanes, free);
}

/// Finds the directions that are in question if the best one has `more` collisions more than before. All lanes call it.
__device__ void askUnlessKnownWorse(const DueWork& work, std::size_t id, int base, int more, DirectionMask& asked,
                                    int lane) {
  std::uint32_t worse = 0;
  const KnownView& known = work.evaluation.known;
  if (known.remembers() && lane < known.slots.words) {
    const KnownRow row(work.points, known, id);
    if (row.counts != nullptr) {
      worse = row.countsOfWord(known.slots, lane).worse(base + more);
    } else {
      const int log2 = known.scale.log2;
      const std::uint32_t steps = (static_cast<std::uint32_t>(more) + (1u << log2) - 1) >> log2;
      constexpr std::uint32_t kMost = KnownLevels::kMost - KnownLevels::kMostFreedSteps + 1;
      const KnownWord word = row.wordOf(known.slots, lane);
      // No level guarantees more than kMost steps; beyond that only corridors count.
      const std::uint64_t lowest = steps <= kMost ? word.freed.lowestWithMore(log2) + known_word::kEach * steps
                                                  : known_word::kEach * (KnownLevels::kMost + 1);
      worse = known_word::worse(word.levels, lowest);
    }
  }
  static_assert(sizeof(DirectionMask) == kWarp);
  reinterpret_cast<std::uint8_t*>(asked.word)[lane] = static_cast<std::uint8_t>(~worse);
}

/// What is known about the best direction of a point before others are tested.
struct BestNow {
  int score, direction;
  int roll = 0;               ///< in that direction
  int tests = 0;              ///< that it took itself
  bool became_worse = false;  ///< than it was; it may still be the best
  bool all_in_question = false;
  bool counted = false;  ///< the tool was tested there
};

/// Evaluates one point with one warp. All lanes call it.
template <class Window, class Counter>
struct WarpEvaluation {
  const DueWork& work;
  const DueSearch& search;
  MapAround<Window> around;
  const DuePoint& point;
  const Counter& counter;
  WarpScratch& scratch;
  int lane;

  /// Evaluates a point with some directions in question.
  /// @return false if all of them are
  __device__ bool confirm(const Due& due) const {
    const int base = baseOf(work, point.id);
    const BestNow best = bestNow(due);
    if (best.all_in_question) {
      if (lane == 0) atomicAdd(&work.outcome->tests, 1ull);
      return false;
    }
    const bool accessible = best.direction != kNoDirection;
    bool any = best.became_worse;
    for (const std::uint64_t word : due.candidates.word) any = any || word != 0;
    ScoreItem& item = scratch.item;
    if (lane == 0) {
      item = {};
      item.id = static_cast<std::uint32_t>(point.id);
      item.known_score = static_cast<std::uint16_t>(best.score);
      item.known_direction = static_cast<std::uint16_t>(best.direction);
      item.known_roll = static_cast<std::uint8_t>(best.roll);
      item.keep_reason = accessible ? 0 : 1;
      item.evidence = due.evidence;
      item.candidates = due.candidates;
    }
    __syncwarp();
    if (best.became_worse) {
      askUnlessKnownWorse(work, point.id, base, best.score - base, item.candidates, lane);
      __syncwarp();
    }
    if (accessible && lane == 0) item.candidates.word[best.direction >> 6] |= std::uint64_t{1} << (best.direction & 63);
    __syncwarp();
    ScoreResult result;
    if (any) {
      result = searchPoint(NothingKnown{});
    } else {
      result.scored = 1;
      if (accessible) {
        result.score = static_cast<std::uint16_t>(best.score);
        result.direction = static_cast<std::uint16_t>(best.direction);
        result.roll = static_cast<std::uint8_t>(best.roll);
        result.reason = PointReason::None;
      }
    }
    result.tests = static_cast<std::uint16_t>(result.tests + best.tests);
    const bool searched = any && result.scored != 0;
    if (best.counted) noteBest(best, searched);
    concludeAndLearn(work, scratch, searched || best.counted, base, result, lane);
    return true;
  }

  /// Evaluates a point whose directions must all be tried.
  __device__ void searchAll(const Due& due) const {
    ScoreItem& item = scratch.item;
    if (lane == 0) {
      item = {};
      item.id = static_cast<std::uint32_t>(point.id);
      item.evidence = due.evidence;
      for (std::uint64_t& word : item.candidates.word) word = ~std::uint64_t{0};
    }
    __syncwarp();
    const int base = baseOf(work, point.id);
    ScoreResult result = searchPoint(KnownOfPoint{work, point.id, base});
    concludeAndLearn(work, scratch, result.scored != 0, base, result, lane);
  }

 private:
  /// Searches scratch.item.
  template <class Known>
  __device__ ScoreResult searchPoint(const Known& known) const {
    const SearchContext<Window, Counter, Known> context = {
        around,
        work.evaluation.approach,
        {point.position_L, point.normal_L, point.seen, work.points.points.direction_words},
        counter,
        search.tool.collision_limit,
        scratch.masks,
        lane,
        known,
        work.evaluation.known.count_to};
    return searchByWarp(context, scratch.item);
  }

  /// Adds the collisions of the best direction to what a search noted: the search takes them as given.
  __device__ void noteBest(const BestNow& best, bool searched) const {
    WarpMasks& masks = scratch.masks;
    __syncwarp();
    if (!searched && lane < kMaskWords32) masks.counted[lane] = masks.arm_blocked[lane] = 0;
    __syncwarp();
    if (lane == 0) {
      masks.counted[best.direction >> 5] |= 1u << (best.direction & 31);
      masks.least[best.direction] = static_cast<std::uint16_t>(best.score);
    }
  }

  __device__ BestNow bestNow(const Due& due) const {
    const PointStateView& points = work.points.points;
    const int limit = static_cast<int>(search.tool.collision_limit);
    BestNow best{limit - 1, kNoDirection};  // a blocked point: only free directions count
    if (points.label[point.id] != PointLabel::Accessible) return best;
    best.score = due.best_score != kNoScore ? due.best_score : points.score[point.id];
    best.direction = points.direction[point.id];
    best.roll = points.rollOf(static_cast<std::uint32_t>(point.id));
    best.all_in_question = best.score >= limit;
    if (due.test_best == 0 || best.all_in_question) return best;
    best.tests = 1;
    const int hits = testBest(due.test_best, best);
    if constexpr (Counter::kRolls) {
      if ((due.test_best & kTestTool) != 0) best.roll = counter.roll;
    }
    best.counted = (due.test_best & kTestTool) != 0 && work.evaluation.known.follows;
    best.became_worse = hits > best.score;
    best.all_in_question = hits >= limit;
    best.score = hits;
    return best;
  }

  /// Tests the best direction of an accessible point again.
  /// @return its collisions, exact below the limit; kNoScore if its corridor is blocked
  __device__ int testBest(std::uint8_t test_best, const BestNow& best) const {
    if ((test_best & kTestArm) != 0 &&
        !armIsFree(around, work.evaluation.approach, best.direction, point.position_L, lane)) {
      return kNoScore;
    }
    if ((test_best & kTestTool) == 0) return best.score;
    return belowNoScore(counter(best.direction, static_cast<int>(search.tool.collision_limit) - 1));
  }
};

/// Puts the items of a block next to each other, one thread per block.
__global__ void orderDue(DueView due) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= due.counters->busy) return;
  std::uint32_t* head = due.head + due.busy[n];
  std::uint32_t count = 0, whole = 0;
  for (std::uint32_t item = *head; item != kNoIndex; item = due.items[item].next) {
    due.items[item].due.kind == DueKind::All ? ++whole : ++count;
  }
  std::uint32_t place = atomicAdd(&due.counters->ordered, count);
  std::uint32_t place_whole = whole > 0 ? atomicAdd(&due.counters->whole, whole) : 0;
  for (std::uint32_t item = *head; item != kNoIndex; item = due.items[item].next) {
    if (due.items[item].due.kind == DueKind::All) {
      due.whole[place_whole++] = item;
    } else {
      due.order[place++] = item;
    }
  }
  *head = kNoIndex;
}

/// Items [*begin, *end) of a list.
struct DueRange {
  const std::uint32_t* list;
  const std::uint32_t* begin;  ///< null: 0
  const std::uint32_t* end;
  std::uint32_t* next;  ///< starts at 0, counts up
};

/// @tparam kAll  whether the items need all directions or only some
template <class Window, class Form, bool kAll>
__global__ void __launch_bounds__(kThreads, kBlocksEach)
    evaluateDue(const __grid_constant__ DueWork work, const __grid_constant__ DueSearch search,
                const __grid_constant__ DueRange range) {
  __shared__ WarpScratch all_scratch[kWarps];
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  WarpScratch& scratch = all_scratch[threadIdx.x / kWarp];
  if (Form::by_slabs && lane == 0) prepareSlabs(search, scratch.slabs);
  const std::uint32_t begin = range.begin != nullptr ? *range.begin : 0, count = *range.end - begin;
  const MapOutside map(search.map);
#pragma unroll 1
  for (std::uint32_t n = takeNext(range.next, lane); n < count; n = takeNext(range.next, lane)) {
    const std::uint32_t which = range.list[begin + n];
    const ListedDue& item = work.due.items[which];
    const DuePoint point(work.points.points, item.id, search.map.inverse_voxel_size);
    const Window window = makeDueWindow<Window>(search, point.ijk, lane);
    const auto counter = makeCounter<Form>(search, window, map, point, scratch, lane);
    const WarpEvaluation<Window, std::decay_t<decltype(counter)>> evaluation = {
        work, search, {window, map, search.map.inverse_voxel_size}, point, counter, scratch, lane};
    if constexpr (kAll) {
      evaluation.searchAll(item.due);
    } else if (!evaluation.confirm(item.due)) {
      if (lane == 0) work.due.whole[atomicAdd(&work.due.counters->whole, 1u)] = which;
      __syncwarp();  // the window it has read is overwritten next
    }
  }
}

template <class Window, class Form>
void launchSearches(const DueWork& work, const DueSearch& search, const DueStreams& streams) {
  // Persistent blocks: as many as run at a time.
  const unsigned blocks = static_cast<unsigned>(search.multiprocessors) * kBlocksEach;
  const std::size_t bytes = kWarps * search.window.entries() * BusyWindow::kEntries * sizeof(std::uint32_t);
  const DueView& due = work.due;
  SearchCounters& counters = *due.counters;
  // Points that need all directions from the outset take longest and start first; once few are left, the others begin.
  // Points that these add come last.
  const DueRange whole = {due.whole, nullptr, &counters.whole_at_first, &counters.next_whole},
                 some = {due.order, nullptr, &counters.ordered, &counters.next_some},
                 added = {due.whole, &counters.whole_at_first, &counters.whole, &counters.next_added};
  ACCESSVDB_CUDA(cudaMemcpyAsync(&counters.whole_at_first, &counters.whole, sizeof(std::uint32_t),
                                 cudaMemcpyDeviceToDevice, streams.main));
  ACCESSVDB_CUDA(cudaEventRecord(streams.fork, streams.main));
  ACCESSVDB_CUDA(cudaStreamWaitEvent(streams.beside, streams.fork));
  evaluateDue<Window, Form, true><<<blocks, kThreads, bytes, streams.beside>>>(work, search, whole);
  checkLaunch("evaluateDue");
  ACCESSVDB_CUDA(cudaEventRecord(streams.join, streams.beside));
  evaluateDue<Window, Form, false><<<blocks, kThreads, bytes, streams.main>>>(work, search, some);
  checkLaunch("evaluateDue");
  ACCESSVDB_CUDA(cudaStreamWaitEvent(streams.main, streams.join));
  evaluateDue<Window, Form, true><<<blocks, kThreads, bytes, streams.main>>>(work, search, added);
  checkLaunch("evaluateDue");
}

}  // namespace

void launchDueSearch(const DueWork& work, const DueSearch& search, std::uint32_t max_busy, const DueStreams& streams) {
  if (max_busy == 0) return;
  orderDue<<<(max_busy + kThreads - 1) / kThreads, kThreads, 0, streams.main>>>(work.due);
  checkLaunch("orderDue");
  launchByForm(search.tool, [&](auto samples, auto rolls) {
    using Form = CountForm<samples ? CountOf::Samples : CountOf::Columns, rolls>;
    if (search.window.kind != WindowPlan::Kind::Lowers) return launchSearches<TreeWindow, Form>(work, search, streams);
    const auto bySlabs = [&](auto rows) {
      search.slabs.thick
          ? launchSearches<BusyWindow, CountForm<CountOf::Slabs, rolls, true, rows>>(work, search, streams)
          : launchSearches<BusyWindow, CountForm<CountOf::Slabs, rolls, false, rows>>(work, search, streams);
    };
    if constexpr (!samples) {
      if (search.slabs.rows != nullptr) return bySlabs(std::true_type());
    }
    if constexpr (!samples && !rolls) {
      if (search.slabs.begin != nullptr) return bySlabs(std::false_type());
    }
    launchSearches<BusyWindow, Form>(work, search, streams);
  });
  ACCESSVDB_CUDA(cudaMemsetAsync(work.due.counters, 0, sizeof(SearchCounters), streams.main));
}

}  // namespace accessvdb::kernels
