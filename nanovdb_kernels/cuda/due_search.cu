// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Evaluates what is due, in two steps: points of which a few directions are in question, and then those that need all
/// of them, among them the ones that the first step sends there.
#include <type_traits>

#include "cuda/cuda_check.h"
#include "cuda/update_kernels.h"
#include "cuda/warp_search.cuh"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4;
constexpr unsigned kBlocksEach = 6;  ///< blocks that a multiprocessor is to hold

extern __shared__ std::uint32_t nodes_of_windows[];

/// A warp's point.
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

template <class Window>
__device__ Window makeDueWindow(const DueSearch& search, const Coord& point_ijk, std::uint32_t entries, int lane) {
  if constexpr (std::is_same_v<Window, TreeWindow>) {
    return TreeWindow(search.map);
  } else {
    return Window(nodes_of_windows + threadIdx.x / kWarp * entries, WindowShape::of(search.tool.reach, Window::kLog2),
                  search.map, point_ijk, lane);
  }
}

/// The next item of a list, the same for all lanes.
__device__ std::uint32_t nextItem(const UpdateView& view, int lane) {
  std::uint32_t n = 0;
  if (lane == 0) n = atomicAdd(&view.counters->next, 1u);
  return __shfl_sync(kAllLanes, n, 0);
}

/// The tool as searches see it: what has `needed` collisions and the margin is told apart by its limit.
__device__ ToolKernelView withMargin(const ToolKernelView& tool, int needed) {
  ToolKernelView wider = tool;
  const int limit = needed + kMarginCollisions;
  wider.collision_limit = static_cast<std::uint16_t>(limit < kNoScore ? limit : kNoScore);  // no count is kNoScore
  return wider;
}

/// After a search with withMargin: remembers the directions told apart, and gives the reason that the limit itself
/// gives. All lanes. @param anew  what was known is not valid any more
__device__ void learn(const UpdateView& view, const DueSearch& search, std::size_t id, const WarpMasks& masks,
                      ScoreResult& result, bool anew, int lane) {
  if (result.score != kNoScore) {
    result.reason = result.score < search.tool.collision_limit ? PointReason::None : PointReason::Tool;
  }
  if (view.offsets.table == nullptr) return;
  const auto words32 = static_cast<std::size_t>(2 * view.points.direction_words);
  const bool has_word = static_cast<std::size_t>(lane) < words32;
  auto* stored = reinterpret_cast<std::uint32_t*>(view.state.worse) + id * words32;
  const std::uint32_t before = has_word && !anew ? stored[lane] : 0;
  const std::uint32_t found = has_word && result.scored != 0 ? masks.tool_blocked[lane] : 0;
  if (has_word && (anew || (found & ~before) != 0)) stored[lane] = before | found;
  if (__all_sync(kAllLanes, before == 0) && lane == 0) view.state.margin[id] = kMarginCollisions;
}

/// One lane.
__device__ void conclude(const UpdateView& view, const ScoreItem& item, ScoreResult& result) {
  const PointLabel before = view.points.label[item.id];
  updatePoint(view.points, item, result, view.update_rule);
  UpdateCounters& counters = *view.counters;
  atomicAdd(&counters.evaluated, 1ull);
  if (result.tests > 0) {
    atomicAdd(&counters.tests, static_cast<unsigned long long>(result.tests));
    atomicAdd(&counters.scored, 1ull);
  }
  if (view.points.label[item.id] != before) atomicAdd(&counters.label_changes, 1ull);
}

/// A direction's corridor, a sample a lane.
template <class Window>
__device__ bool armIsFree(const Window& window, const OccupancyReader& map, const ApproachView& approach, int d,
                          const float* position_L, float inverse_voxel_size, int lane) {
  bool free = true;
  for (int n = lane; n < approach.num_arm; n += static_cast<int>(kWarp)) {
    const float* offset = approach.arm_offsets + 3 * (static_cast<std::int64_t>(d) * approach.num_arm + n);
    const Coord ijk =
        voxelOf(position_L[0] + offset[0], position_L[1] + offset[1], position_L[2] + offset[2], inverse_voxel_size);
    free = free && (window.holds(ijk) ? window.armFree(ijk) : map.armFree(ijk));
  }
  return __all_sync(kAllLanes, free);
}

template <class Window>
__global__ void __launch_bounds__(kWarps* kWarp, kBlocksEach)
    confirmDue(UpdateView view, DueSearch search, std::uint32_t entries) {
  __shared__ WarpMasks all_masks[kWarps];
  __shared__ ScoreItem all_items[kWarps];
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  WarpMasks& masks = all_masks[threadIdx.x / kWarp];
  ScoreItem& item = all_items[threadIdx.x / kWarp];
  const float inverse = search.map.inverse_voxel_size;
  const std::uint32_t count = view.counters->due;
  for (std::uint32_t n = nextItem(view, lane); n < count; n = nextItem(view, lane)) {
    const DueItem& due = view.due[n];
    const DuePoint point(view.points, due.id, inverse);
    const Window window = makeDueWindow<Window>(search, point.ijk, entries, lane);
    const OccupancyReader map(search.map);
    const bool accessible = view.points.label[point.id] == PointLabel::Accessible;
    int known_score = static_cast<int>(search.tool.collision_limit) - 1;  // a blocked point: only what is free counts
    int known_direction = kNoDirection;
    std::uint16_t own_tests = 0;
    if (accessible) {
      known_direction = view.points.direction[point.id];
      known_score = view.points.score[point.id];
      if (due.test_best != 0) {
        own_tests = 1;
        bool worse = (due.test_best & kTestArm) != 0 &&
                     !armIsFree(window, map, view.approach, known_direction, point.position_L, inverse, lane);
        if (!worse && (due.test_best & kTestTool) != 0) {
          const int hits = search.tool.use_samples ? countSamplesByWarp(window, map, search.tool, known_direction,
                                                                        point.position_L, inverse, known_score, lane)
                                                   : countVoxelsByWarp<2>(window, search.tool, known_direction,
                                                                          point.ijk, known_score, lane);
          worse = hits > known_score;
          if (!worse) known_score = hits;
        }
        if (worse) {  // the others are known to be no better than this one was
          if (lane == 0) {
            view.full[atomicAdd(&view.counters->full, 1u)] = {due.id, due.evidence};
            atomicAdd(&view.counters->tests, 1ull);
          }
          __syncwarp();
          continue;
        }
      }
    }
    std::uint64_t any = 0;
    for (const std::uint64_t word : due.candidates.word) any |= word;
    ScoreResult result;
    if (any == 0) {
      result.scored = 1;
      if (accessible) {
        result.score = static_cast<std::uint16_t>(known_score);
        result.direction = static_cast<std::uint16_t>(known_direction);
        result.reason = PointReason::None;
      }
    }
    if (lane == 0) {
      item = {};
      item.id = due.id;
      item.known_score = static_cast<std::uint16_t>(known_score);
      item.known_direction = static_cast<std::uint16_t>(known_direction);
      item.keep_reason = accessible ? 0 : 1;
      item.evidence = due.evidence;
      for (int w = 0; w < kMaxDirectionWords; ++w) {
        item.skip.word[w] = ~due.candidates.word[w];
        item.candidates.word[w] = ~std::uint64_t{0};
      }
    }
    __syncwarp();
    if (any != 0) {
      result = searchByWarp(window, map, inverse, withMargin(search.tool, known_score + 1), view.approach,
                            point.position_L, point.normal_L, point.seen, view.points.direction_words, item, masks,
                            lane, view.offsets.table != nullptr ? kMarginCollisions : 0);
      learn(view, search, point.id, masks, result, false, lane);
    }
    result.tests = static_cast<std::uint16_t>(result.tests + own_tests);
    if (lane == 0) conclude(view, item, result);
    __syncwarp();
  }
}

template <class Window>
__global__ void __launch_bounds__(kWarps* kWarp, kBlocksEach)
    searchDue(UpdateView view, DueSearch search, std::uint32_t entries) {
  __shared__ WarpMasks all_masks[kWarps];
  __shared__ ScoreItem all_items[kWarps];
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  WarpMasks& masks = all_masks[threadIdx.x / kWarp];
  ScoreItem& item = all_items[threadIdx.x / kWarp];
  const std::uint32_t count = view.counters->full;
  for (std::uint32_t n = nextItem(view, lane); n < count; n = nextItem(view, lane)) {
    const FullItem& full = view.full[n];
    const DuePoint point(view.points, full.id, search.map.inverse_voxel_size);
    const Window window = makeDueWindow<Window>(search, point.ijk, entries, lane);
    const OccupancyReader map(search.map);
    if (lane == 0) {
      item = {};
      item.id = full.id;
      item.evidence = static_cast<std::uint8_t>(full.evidence);
      for (std::uint64_t& word : item.candidates.word) word = ~std::uint64_t{0};
    }
    __syncwarp();
    ScoreResult result = searchByWarp(
        window, map, search.map.inverse_voxel_size, withMargin(search.tool, search.tool.collision_limit), view.approach,
        point.position_L, point.normal_L, point.seen, view.points.direction_words, item, masks, lane);
    learn(view, search, point.id, masks, result, true, lane);
    if (lane == 0) conclude(view, item, result);
    __syncwarp();
  }
}

/// Persistent blocks: as many as the device holds at a time.
template <class OfLeaves, class OfLowers, class OfTree>
void launchPersistent(const UpdateView& view, const DueSearch& search, const WindowPlan& plan, cudaStream_t stream,
                      OfLeaves* of_leaves, OfLowers* of_lowers, OfTree* of_tree) {
  ACCESSVDB_CUDA(cudaMemsetAsync(&view.counters->next, 0, sizeof(std::uint32_t), stream));
  const auto bytes = static_cast<std::uint32_t>(kWarps * plan.entries * sizeof(std::uint32_t));
  const auto launch = [&](auto* kernel) {
    kernel<<<static_cast<unsigned>(search.multiprocessors) * kBlocksEach, kWarps * kWarp, bytes, stream>>>(
        view, search, plan.entries);
  };
  switch (plan.kind) {
    case WindowPlan::Kind::Leaves:
      launch(of_leaves);
      break;
    case WindowPlan::Kind::Lowers:
      launch(of_lowers);
      break;
    case WindowPlan::Kind::None:
      launch(of_tree);
      break;
  }
}

}  // namespace

void launchDueSearch(const UpdateView& view, const DueSearch& search, cudaStream_t stream) {
  launchPersistent(view, search, search.confirm_window, stream, confirmDue<MapWindow<LeafWindow>>,
                   confirmDue<MapWindow<LowerWindow>>, confirmDue<TreeWindow>);
  checkLaunch("confirmDue");
  launchPersistent(view, search, search.full_window, stream, searchDue<MapWindow<LeafWindow>>,
                   searchDue<MapWindow<LowerWindow>>, searchDue<TreeWindow>);
  checkLaunch("searchDue");
  ACCESSVDB_CUDA(cudaMemsetAsync(&view.counters->due, 0, sizeof(std::uint32_t), stream));
  ACCESSVDB_CUDA(cudaMemsetAsync(&view.counters->full, 0, sizeof(std::uint32_t), stream));
}

}  // namespace accessvdb::kernels
