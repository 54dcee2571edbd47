// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/search/score_kernels.h"

#include <algorithm>
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/search_parts.cuh"
#include "cuda/search/warp_search.cuh"
#include "hostdev/point_update.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 128;  ///< per block, if each works alone
constexpr unsigned kWarps = 4;      ///< per block, with one warp per point
/// Blocks that a multiprocessor should hold: this limits the registers, with almost no spilling.
constexpr unsigned kSearchBlocks = 6, kCountBlocks = 8;
/// Limit per warp: 24 warps leave half of a multiprocessor's memory to the cache through which leaves are read.
constexpr std::int64_t kMostLeafWindowBytes = 4 * 1024;

__global__ void plainSearch(ScoreChunk chunk) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= chunk.count) return;
  const OccupancyReader map(chunk.map);
  const ScoreItem item = chunk.items[n];
  const std::size_t id = item.id;
  chunk.results[n] =
      searchDirections(map, chunk.map.inverse_voxel_size, chunk.tool, chunk.approach, chunk.points.position_L + 3 * id,
                       chunk.points.normal_L + 3 * id,
                       chunk.points.seen + id * static_cast<std::size_t>(chunk.points.direction_words), item);
}

__global__ void updatePoints(ScoreChunk chunk) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= chunk.count) return;
  ScoreResult result = chunk.results[n];
  updatePoint(chunk.points, chunk.items[n], result, chunk.rule);
  chunk.results[n].label = result.label;
  chunk.results[n].stored_score = result.stored_score;
  chunk.results[n].stored_direction = result.stored_direction;
  chunk.results[n].stored_roll = result.stored_roll;
}

__global__ void writeInputs(PointStateView points, const PointInput* inputs, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < count) writePoint(points, inputs[n]);
}

__global__ void writeRows(PointStateView points, SeenRows rows) {
  const auto words = static_cast<std::uint32_t>(points.direction_words);
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < rows.count * words) points.seen[std::size_t{rows.ids[n / words]} * words + n % words] = rows.words[n];
}

/// @tparam kRolls  whether the tool rolls
template <class Window, bool kSamples, bool kRolls>
__global__ void __launch_bounds__(kWarps* kWarp, kSearchBlocks) warpSearch(ScoreChunk chunk, WindowPlan plan) {
  __shared__ WarpMasks all_masks[kWarps];
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  WarpMasks& masks = all_masks[threadIdx.x / kWarp];
  const SearchedPoint point = pointOfWarp(chunk, kWarps);
  if (!point.there) return;
  const Window window = makeWarpWindow<Window>(chunk, point, plan, lane);
  const MapOutside map(chunk.map);
  const int words = chunk.points.direction_words;
  const float normal_L[3] = {chunk.points.normal_L[3 * point.id], chunk.points.normal_L[3 * point.id + 1],
                             chunk.points.normal_L[3 * point.id + 2]};
  const float inverse = chunk.map.inverse_voxel_size;
  const SearchPoint searched = {point.position_L, normal_L,
                                chunk.points.seen + point.id * static_cast<std::size_t>(words), words};
  const auto search = [&](const auto& counter) {
    const SearchContext<Window, std::decay_t<decltype(counter)>> context = {
        {window, map, inverse}, chunk.approach, searched, counter, chunk.tool.collision_limit, masks, lane};
    return searchByWarp(context, chunk.items[point.item]);
  };
  const auto of_part = partCounter<kSamples>(chunk, window, map, point, lane);
  ScoreResult result;
  if constexpr (kRolls) {
    result = search(RollCounter<std::decay_t<decltype(of_part)>, true>{of_part, chunk.tool.parts});
  } else {
    result = search(of_part);
  }
  ScoreResult& out = chunk.results[point.item];
  if (lane == 0) {
    out.score = result.score;
    out.direction = result.direction;
    out.reason = result.reason;
    out.scored = result.scored;
    out.roll = result.roll;
    out.skipped = result.skipped;
    out.tests = result.tests;
    out.least_blocked = result.least_blocked;
    out.label = result.label;
    out.stored_score = result.stored_score;
    out.stored_direction = result.stored_direction;
    out.stored_roll = result.stored_roll;
  }
  if (lane < kMaskWords32) {
    reinterpret_cast<std::uint32_t*>(out.arm_blocked.word)[lane] = result.scored != 0 ? masks.arm_blocked[lane] : 0;
    reinterpret_cast<std::uint32_t*>(out.tool_blocked.word)[lane] = result.scored != 0 ? masks.tool_blocked[lane] : 0;
  }
}

template <class Window, bool kSamples>
__global__ void __launch_bounds__(kWarps* kWarp, kCountBlocks)
    countAll(ScoreChunk chunk, WindowPlan plan, std::uint16_t* counts) {
  constexpr int kNoStop = 0x7fffffff;
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  const SearchedPoint point = pointOfWarp(chunk, kWarps);
  if (!point.there) return;
  const Window window = makeWarpWindow<Window>(chunk, point, plan, lane);
  const MapOutside map(chunk.map);
  for (int d = 0; d < chunk.approach.num_directions; ++d) {
    __syncthreads();  // keeps the warps of a block together, so that one loads the tool into the cache for all
    int hits = 0;
    if (chunk.tool.parts > 1) {
      hits =
          countAxisByWarp(partCounter<kSamples>(chunk, window, map, point, lane), chunk.tool.parts, d, kNoStop).count;
    } else if constexpr (kSamples) {
      hits =
          countSamplesByWarp(window, map, chunk.tool, d, point.position_L, chunk.map.inverse_voxel_size, kNoStop, lane);
    } else {
      hits = countVoxelsByWarp<4>(window, chunk.tool, d, point.ijk, kNoStop, lane);
    }
    if (lane == 0) {
      counts[static_cast<std::size_t>(point.item) * static_cast<std::size_t>(chunk.approach.num_directions) +
             static_cast<std::size_t>(d)] = static_cast<std::uint16_t>(hits < kNoScore ? hits : kNoScore - 1);
    }
  }
}

template <class Window>
void allowShared(int shared_bytes_per_block) {
  for (const void* kernel : {reinterpret_cast<const void*>(&warpSearch<Window, false, false>),
                             reinterpret_cast<const void*>(&warpSearch<Window, true, false>),
                             reinterpret_cast<const void*>(&warpSearch<Window, false, true>),
                             reinterpret_cast<const void*>(&warpSearch<Window, true, true>),
                             reinterpret_cast<const void*>(&countAll<Window, false>),
                             reinterpret_cast<const void*>(&countAll<Window, true>)}) {
    allowAllShared(kernel, shared_bytes_per_block);
  }
}

}  // namespace

void requireScoreKernels(int shared_bytes_per_block) {
  cudaFuncAttributes attributes = {};
  const cudaError_t status = cudaFuncGetAttributes(&attributes, reinterpret_cast<const void*>(&plainSearch));
  if (status == cudaSuccess) {
    allowShared<WindowReader<LeafWindow>>(shared_bytes_per_block);
    allowShared<WindowReader<LowerWindow>>(shared_bytes_per_block);
    allowWideSearch(shared_bytes_per_block);
    return;
  }
  (void)cudaGetLastError();
  if (status == cudaErrorNoKernelImageForDevice || status == cudaErrorInvalidDeviceFunction ||
      status == cudaErrorUnsupportedPtxVersion) {
    throw DeviceError("device.architecture", "cuda", "this program was not built for the architecture of this GPU",
                      "Build with its number in ACCESSVDB_CUDA_ARCHITECTURES, or use BackendKind::Cpu");
  }
  checkCuda(status, "cudaFuncGetAttributes");
}

WindowPlan planWindow(const ToolKernelView& tool, int shared_bytes_per_block, bool leaves) {
  for (int axis = 0; axis < 3; ++axis) {
    if (tool.reach.low[axis] > tool.reach.high[axis]) return {};
  }
  const std::int64_t room =
      (shared_bytes_per_block - 1024 - static_cast<std::int64_t>(kWarps * sizeof(WarpMasks))) / kWarps;
  const auto fits = [&](std::int64_t entries, std::int64_t most_bytes) {
    return entries * static_cast<std::int64_t>(sizeof(std::uint32_t)) <= std::min(room, most_bytes);
  };
  const WindowShape in_leaves = WindowShape::of(tool.reach, kLeafLog2),
                    in_lowers = WindowShape::of(tool.reach, kLowerLog2);
  if (leaves && fits(in_leaves.nodes(), kMostLeafWindowBytes)) return {WindowPlan::Kind::Leaves, in_leaves};
  if (fits(in_lowers.nodes(), room)) return {WindowPlan::Kind::Lowers, in_lowers};
  return {};
}

void launchPlainSearch(const ScoreChunk& chunk, cudaStream_t stream) {
  if (chunk.count == 0) return;
  plainSearch<<<blocksFor(chunk.count, kThreads), kThreads, 0, stream>>>(chunk);
  checkLaunch("plainSearch");
}

void launchWarpSearch(const ScoreChunk& chunk, const WindowPlan& plan, cudaStream_t stream) {
  if (chunk.count == 0) return;
  launchByForm(chunk.tool, [&](auto samples, auto rolls) {
    constexpr bool kSamples = decltype(samples)::value, kRolls = decltype(rolls)::value;
    launchSearch(chunk, plan, {kWarps, 1, 0, stream}, warpSearch<WindowReader<LeafWindow>, kSamples, kRolls>,
                 warpSearch<WindowReader<LowerWindow>, kSamples, kRolls>, warpSearch<TreeWindow, kSamples, kRolls>);
  });
  checkLaunch("warpSearch");
}

void launchUpdate(const ScoreChunk& chunk, cudaStream_t stream) {
  if (chunk.count == 0) return;
  updatePoints<<<blocksFor(chunk.count, kThreads), kThreads, 0, stream>>>(chunk);
  checkLaunch("updatePoints");
}

void launchCount(const ScoreChunk& chunk, const WindowPlan& plan, std::uint16_t* counts, cudaStream_t stream) {
  if (chunk.count == 0) return;
  if (chunk.tool.use_samples) {
    launchSearch(chunk, plan, {kWarps, 1, 0, stream}, countAll<WindowReader<LeafWindow>, true>,
                 countAll<WindowReader<LowerWindow>, true>, countAll<TreeWindow, true>, counts);
  } else {
    launchSearch(chunk, plan, {kWarps, 1, 0, stream}, countAll<WindowReader<LeafWindow>, false>,
                 countAll<WindowReader<LowerWindow>, false>, countAll<TreeWindow, false>, counts);
  }
  checkLaunch("countAll");
}

void launchWriteSeen(const PointStateView& points, const SeenRows& rows, cudaStream_t stream) {
  if (rows.count == 0) return;
  const std::uint32_t words = rows.count * static_cast<std::uint32_t>(points.direction_words);
  writeRows<<<blocksFor(words, kThreads), kThreads, 0, stream>>>(points, rows);
  checkLaunch("writeRows");
}

void launchWrite(const PointStateView& points, const PointInput* inputs, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  writeInputs<<<blocksFor(count, kThreads), kThreads, 0, stream>>>(points, inputs, count);
  checkLaunch("writeInputs");
}

}  // namespace accessvdb::kernels
