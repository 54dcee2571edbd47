// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What kernels that search points have in common: which point, the window around it, and how its tool is counted.
#pragma once

#include <cstdint>
#include <type_traits>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/launch_by_form.h"
#include "cuda/search/leaf_window.cuh"
#include "cuda/search/score_kernels.h"
#include "cuda/search/warp_search.cuh"

namespace accessvdb::kernels {

inline unsigned blocksFor(std::uint32_t count, unsigned each) { return (count + each - 1) / each; }

/// The point of this warp or block; one beyond the last point has none.
struct SearchedPoint {
  bool there = false;
  std::uint32_t item = 0;
  std::size_t id = 0;
  float position_L[3] = {0, 0, 0};
  Coord ijk;

  /// @param n  place in the order
  __device__ SearchedPoint(const ScoreChunk& chunk, std::uint32_t n) {
    there = n < chunk.count;
    if (!there) return;
    item = chunk.order != nullptr ? chunk.order[n] : n;
    id = chunk.items[item].id;
    for (int axis = 0; axis < 3; ++axis) position_L[axis] = chunk.points.position_L[3 * id + axis];
    ijk = voxelOf(position_L[0], position_L[1], position_L[2], chunk.map.inverse_voxel_size);
  }
};

/// The point of this warp, of kernels with one warp per point.
__device__ inline SearchedPoint pointOfWarp(const ScoreChunk& chunk, unsigned warps_per_block) {
  return {chunk, blockIdx.x * warps_per_block + threadIdx.x / kWarp};
}

/// Dynamic shared memory: one window per point.
extern __shared__ std::uint32_t window_nodes[];

/// Makes a window around a point. The threads that share it call it, and synchronise before they read.
/// @param nodes  [entries of the plan]
template <class Window>
__device__ Window makeWindow(const ScoreChunk& chunk, const SearchedPoint& point, const WindowPlan& plan,
                             std::uint32_t* nodes, Together together) {
  if constexpr (std::is_same_v<Window, TreeWindow>) {
    return TreeWindow(chunk.map);
  } else {
    return Window(nodes, plan.shape, chunk.map, point.ijk, together);
  }
}
/// Makes this warp's window around its point. All lanes call it.
template <class Window>
__device__ Window makeWarpWindow(const ScoreChunk& chunk, const SearchedPoint& point, const WindowPlan& plan,
                                 int lane) {
  const Window window = makeWindow<Window>(chunk, point, plan, window_nodes + threadIdx.x / kWarp * plan.entries(),
                                           {lane, static_cast<int>(kWarp)});
  __syncwarp();
  return window;
}

/// Counts parts of the tool at a warp's point. @tparam kTurns  columns in flight per lane
template <bool kSamples, int kTurns = 2, class Window>
__device__ auto partCounter(const ScoreChunk& chunk, const Window& window, const MapOutside& map,
                            const SearchedPoint& point, int lane) {
  if constexpr (kSamples) {
    return SampleCounter<Window>{window, map, chunk.tool, point.position_L, chunk.map.inverse_voxel_size, lane};
  } else {
    return ColumnCounter<Window, kTurns>{window, chunk.tool, point.ijk, lane};
  }
}

/// Blocks get more than 48 KB of shared memory only on request. Asks once, for the maximum: several fields of a process
/// launch the same kernels.
inline void allowAllShared(const void* kernel, int shared_bytes_per_block) {
  cudaFuncAttributes attributes = {};
  ACCESSVDB_CUDA(cudaFuncGetAttributes(&attributes, kernel));
  const int rest = shared_bytes_per_block - static_cast<int>(attributes.sharedSizeBytes);
  ACCESSVDB_CUDA(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, rest));
}

/// How a kernel that searches points is launched.
struct SearchLaunch {
  unsigned points = 0;                ///< per block
  unsigned warps = 1;                 ///< per point
  std::uint32_t bytes_per_point = 0;  ///< of dynamic shared memory behind the windows
  cudaStream_t stream = nullptr;
};

/// Launches a kernel with the window of the plan.
template <class OfLeaves, class OfLowers, class OfTree, class... Arguments>
void launchSearch(const ScoreChunk& chunk, const WindowPlan& plan, const SearchLaunch& how, OfLeaves* of_leaves,
                  OfLowers* of_lowers, OfTree* of_tree, Arguments... arguments) {
  const unsigned blocks = blocksFor(chunk.count, how.points);
  const auto bytes =
      static_cast<std::uint32_t>(how.points * (plan.entries() * sizeof(std::uint32_t) + how.bytes_per_point));
  const auto launch = [&](auto* kernel) {
    kernel<<<blocks, how.points * how.warps * kWarp, bytes, how.stream>>>(chunk, plan, arguments...);
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

}  // namespace accessvdb::kernels
