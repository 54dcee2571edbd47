// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves around a point each direction reads: the exact filter that runs before re-testing.
#pragma once

#include <bit>
#include <span>
#include <vector>

#include "hostdev/due_rule.h"
#include "hostdev/views.h"
#include "launch/exact_updater.h"
#include "points/point_store.h"
#include "update/flip_columns.h"
#include "update/flip_set.h"

namespace accessvdb::internal {

/// Directions of a block of points that flips may affect, at leaf resolution. "Better": the direction reads a leaf with
/// a flip that can only help; "worse": one with a flip that can only hurt.
using AffectedDirections = kernels::GroupMasks;

class LeafFootprint {
 public:
  /// Of a wide set (kernels::isWide), direction 0 stands for all of them.
  /// @param tool, approach  host-side tables
  /// @param group_log2  points lie anywhere in a group of blocks, a cube with an edge of 2^group_log2 leaves, and
  /// columns are relative to its first leaf; 0: anywhere in a block
  LeafFootprint(const kernels::ToolKernelView& tool, const kernels::ApproachView& approach, double voxel_size_m,
                int group_log2);

  /// Yaw directions: one column per horizontal offset. Others: one per leaf, those above each other in a row from the
  /// lowest up, because a column as a whole names nearly all of them.
  [[nodiscard]] std::span<const kernels::FootprintColumn> toolColumns() const { return tool_.columns; }
  [[nodiscard]] std::span<const kernels::FootprintColumn> armColumns() const { return arm_.columns; }

  /// Columns [begin, end) at one horizontal offset.
  struct Stack {
    std::uint32_t begin, end;
  };
  [[nodiscard]] std::span<const Stack> toolStacks() const { return tool_.stacks; }

  /// Box of all columns, inclusive, relative to the first leaf of a group.
  [[nodiscard]] const Index3& low() const { return low_; }
  [[nodiscard]] const Index3& high() const { return high_; }

  /// Conservative, for all points of a block, wherever they lie in it. @param block_leaf  the first leaf of a group
  /// @param flips  of all leaves block_leaf + low() .. block_leaf + high(), or more
  [[nodiscard]] AffectedDirections affected(const Index3& block_leaf, const FlipColumns& flips) const;

 private:
  struct Stacks {
    std::vector<kernels::FootprintColumn> columns;
    std::vector<Stack> stacks;
  };
  Stacks tool_, arm_;
  Index3 low_ = {}, high_ = {};  ///< box of all columns, relative to the first leaf
};

}  // namespace accessvdb::internal
