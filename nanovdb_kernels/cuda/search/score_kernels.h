// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches the kernels that work on point state. All pointers are device memory; calls only queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "cuda/search/window_plan.h"
#include "launch/backend.h"

namespace accessvdb::kernels {

/// One chunk of a ScoreRequest.
struct ScoreChunk {
  OccupancyView map;
  ToolKernelView tool;
  ApproachView approach;
  PointStateView points;
  UpdateRule rule;
  const ScoreItem* items = nullptr;      ///< [count]
  const std::uint32_t* order = nullptr;  ///< [count] items, leaf by leaf; null: as they come
  ScoreResult* results = nullptr;        ///< [count]
  std::uint32_t count = 0;
};

/// @throw DeviceError  this program was built without code for the device
void requireScoreKernels(int shared_bytes_per_block);

/// Searches all items by the plain rule, one thread per item.
void launchPlainSearch(const ScoreChunk& chunk, cudaStream_t stream);
/// The same with one warp per item. @param plan  from planWindow
void launchWarpSearch(const ScoreChunk& chunk, const WindowPlan& plan, cudaStream_t stream);
/// Searches all items of a wide set, one block per item. @param plan  from planWindow
void launchWideSearch(const ScoreChunk& chunk, WindowPlan plan, int shared_bytes_per_block, cudaStream_t stream);
/// Once per process and device, before it.
void allowWideSearch(int shared_bytes_per_block);
/// Updates the state of the points after a search, and stores it in the results.
void launchUpdate(const ScoreChunk& chunk, cudaStream_t stream);
/// Counts collisions in every direction of every point, without filter or early stop: counts [chunk.count x D].
void launchCount(const ScoreChunk& chunk, const WindowPlan& plan, std::uint16_t* counts, cudaStream_t stream);
/// Seen directions of points of a wide set.
struct SeenRows {
  const std::uint32_t* ids = nullptr;    ///< [count]
  const std::uint64_t* words = nullptr;  ///< [count x PointStateView::direction_words]
  std::uint32_t count = 0;
};
void launchWriteSeen(const PointStateView& points, const SeenRows& rows, cudaStream_t stream);
void launchWrite(const PointStateView& points, const PointInput* inputs, std::uint32_t count, cudaStream_t stream);

/// Orders items leaf by leaf. @param keys, sorted, order_in  scratch [count]
/// @param bytes  of scratch memory; with scratch == nullptr, only set to what `count` items need
void launchLeafOrder(const ScoreChunk& chunk, std::uint32_t* keys, std::uint32_t* sorted, std::uint32_t* order_in,
                     std::uint32_t* order, void* scratch, std::size_t& bytes, cudaStream_t stream);
/// Orders blocks of points, near ones close together. @param leaf  [3 blocks]  @param blocks  [count]
/// @param keys, sorted  scratch [count]  @param scratch, bytes  as above
void launchBlockOrder(const std::int32_t* leaf, const std::uint32_t* blocks, std::uint32_t count, std::uint32_t* keys,
                      std::uint32_t* sorted, std::uint32_t* order, void* scratch, std::size_t& bytes,
                      cudaStream_t stream);

}  // namespace accessvdb::kernels
