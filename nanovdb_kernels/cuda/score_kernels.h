// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Launches of the kernels that work on point state. All pointers are device memory; all calls only queue work.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

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
  const std::uint32_t* order = nullptr;  ///< [count] items of one leaf behind each other; null: as they come
  ScoreResult* results = nullptr;        ///< [count]
  std::uint32_t count = 0;
};

/// @throw DeviceError  this program has no code for the device
void requireScoreKernels(int shared_bytes_per_block);
/// Nodes of 2^log2 voxels that a window holds: how many, and where it begins relative to the node of the point. The
/// same for all points.
struct WindowShape {
  std::int32_t begin[3] = {0, 0, 0};  ///< [nodes] from the node of the point
  std::int32_t size[3] = {0, 0, 0};   ///< [nodes]

  /// @param reach  of the tool, from the voxel of a point, which may be any voxel of its node
  ACCESSVDB_HOSTDEV static WindowShape of(const VoxelBox& reach, int log2) {
    WindowShape shape;
    for (int axis = 0; axis < 3; ++axis) {
      shape.begin[axis] = reach.low[axis] >> log2;
      shape.size[axis] = ((reach.high[axis] + (1 << log2) - 1) >> log2) - shape.begin[axis] + 1;
    }
    return shape;
  }
  ACCESSVDB_HOSTDEV std::int64_t nodes() const { return static_cast<std::int64_t>(size[0]) * size[1] * size[2]; }
};
/// What a warp keeps of the map around its point.
struct WindowPlan {
  enum class Kind { None, Leaves, Lowers };
  Kind kind = Kind::None;
  WindowShape shape;
  /// Entries of a warp's window.
  ACCESSVDB_HOSTDEV std::uint32_t entries() const { return static_cast<std::uint32_t>(shape.nodes()); }
};
/// Leaves where they fit, else lower nodes; None where the tool's reach is not known, or there is too little shared
/// memory.
/// @param leaves  false: no window of leaves
[[nodiscard]] WindowPlan planWindow(const ToolKernelView& tool, int shared_bytes_per_block, bool leaves);

/// Search of all items, a thread each, by the plain rule.
void launchPlainSearch(const ScoreChunk& chunk, cudaStream_t stream);
/// The same, a warp each. @param plan  from planWindow
void launchWarpSearch(const ScoreChunk& chunk, const WindowPlan& plan, cudaStream_t stream);
/// State of the points after a search, and what the results say of it.
void launchUpdate(const ScoreChunk& chunk, cudaStream_t stream);
/// Collisions of every direction of every point, no filter and no early stop: counts [chunk.count x D].
void launchCount(const ScoreChunk& chunk, const WindowPlan& plan, std::uint16_t* counts, cudaStream_t stream);
void launchWrite(const PointStateView& points, const PointInput* inputs, std::uint32_t count, cudaStream_t stream);

/// Puts items of one leaf behind each other. @param keys, sorted, order_in  scratch [count]
/// @param bytes  of scratch memory; with scratch == nullptr it is only said how much is needed for `count`
void launchLeafOrder(const ScoreChunk& chunk, std::uint32_t* keys, std::uint32_t* sorted, std::uint32_t* order_in,
                     std::uint32_t* order, void* scratch, std::size_t& bytes, cudaStream_t stream);

}  // namespace accessvdb::kernels
