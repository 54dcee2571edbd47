// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much of the map a search warp keeps in shared memory.
#pragma once

#include <cstdint>

#include "launch/backend.h"

namespace accessvdb::kernels {

/// Extent of a window in nodes of 2^log2 voxels, and its first node relative to a point's node. The same for all
/// points.
struct WindowShape {
  std::int32_t begin[3] = {0, 0, 0};  ///< [nodes] from the node of the point
  std::int32_t size[3] = {0, 0, 0};   ///< [nodes]

  /// @param reach  of the tool, relative to a point's voxel, which may be any voxel of its node
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
  /// Entries per warp's window.
  ACCESSVDB_HOSTDEV std::uint32_t entries() const { return static_cast<std::uint32_t>(shape.nodes()); }
};

/// Leaves if they fit, else lower nodes; None if the tool's reach is unknown or shared memory is too small.
/// @param leaves  false: never plan a window of leaves
[[nodiscard]] WindowPlan planWindow(const ToolKernelView& tool, int shared_bytes_per_block, bool leaves);

}  // namespace accessvdb::kernels
