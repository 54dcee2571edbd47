// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/search/told_points.h"

#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;

__global__ void __launch_bounds__(kThreads) readRows(const __grid_constant__ PointStateView points,
                                                     const std::uint32_t* ids, StateRow* rows, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n < count) rows[n] = stateRowOf(points, ids[n]);
}

/// A point per thread, half a word of bits per warp.
__global__ void __launch_bounds__(kThreads)
    takeEachTold(const __grid_constant__ PointStateView points, const __grid_constant__ ToldStates states) {
  const std::uint32_t id = blockIdx.x * kThreads + threadIdx.x;
  const bool differs = id < states.count && takeTold(points, states, id);
  const std::uint32_t bits = __ballot_sync(kAllLanes, differs);
  const std::uint32_t halves = (states.count + 63) / 64 * 2;
  if (id % kWarp == 0 && id / kWarp < halves) reinterpret_cast<std::uint32_t*>(states.differ)[id / kWarp] = bits;
}

unsigned blocksOf(std::uint32_t threads) { return threads / kThreads + (threads % kThreads != 0 ? 1 : 0); }

}  // namespace

void launchReadRows(const PointStateView& points, const std::uint32_t* ids, StateRow* rows, std::uint32_t count,
                    cudaStream_t stream) {
  if (count == 0) return;
  readRows<<<blocksOf(count), kThreads, 0, stream>>>(points, ids, rows, count);
  checkLaunch("readRows");
}

void launchTakeTold(const PointStateView& points, const ToldStates& states, cudaStream_t stream) {
  if (states.count == 0) return;
  takeEachTold<<<blocksOf(states.count), kThreads, 0, stream>>>(points, states);
  checkLaunch("takeEachTold");
}

}  // namespace accessvdb::kernels
