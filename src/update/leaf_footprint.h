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
  /// @param tool, approach  host-side tables
  /// @param group_log2  points lie anywhere in a group of blocks, a cube with an edge of 2^group_log2 leaves, and
  /// columns are relative to its first leaf; 0: anywhere in a block
  LeafFootprint(const kernels::ToolKernelView& tool, const kernels::ApproachView& approach, double voxel_size_m,
                int group_log2);

  [[nodiscard]] std::span<const kernels::FootprintColumn> toolColumns() const { return tool_columns_; }
  [[nodiscard]] std::span<const kernels::FootprintColumn> armColumns() const { return arm_columns_; }

  /// Box of all columns, inclusive, relative to the first leaf of a group.
  [[nodiscard]] const Index3& low() const { return low_; }
  [[nodiscard]] const Index3& high() const { return high_; }

  /// Gathers the flips that the points of a block may query. @param block_leaf  the first leaf of a group
  /// @return false if there are none
  bool fill(const Index3& block_leaf, const FlipSet& flips, FlipWindow& window) const;

  // Flips is a FlipSet, or a FlipWindow filled for the point's block.

  /// Conservative, for all points of a block, wherever they lie in it. @param block_leaf  the first leaf of a group
  template <typename Flips>
  [[nodiscard]] AffectedDirections affected(const Index3& block_leaf, const Flips& flips) const;

  [[nodiscard]] AffectedDirections affected(const Index3& block_leaf, const FlipColumns& flips) const;

  /// Voxel-exact: does direction d, tried from this point, read a voxel with such a flip?
  template <typename Flips>
  [[nodiscard]] bool toolBetter(const Eigen::Vector3f& position_L, int d, const Flips& flips) const {
    return toolReads(position_L, d, flips, FlipKind::CollidesOff);
  }
  template <typename Flips>
  [[nodiscard]] bool toolWorse(const Eigen::Vector3f& position_L, int d, const Flips& flips) const {
    return toolReads(position_L, d, flips, FlipKind::CollidesOn);
  }
  template <typename Flips>
  [[nodiscard]] bool armBetter(const Eigen::Vector3f& position_L, int d, const Flips& flips) const {
    return armReads(position_L, d, flips, FlipKind::ArmFreeOn);
  }
  template <typename Flips>
  [[nodiscard]] bool armWorse(const Eigen::Vector3f& position_L, int d, const Flips& flips) const {
    return armReads(position_L, d, flips, FlipKind::ArmFreeOff);
  }

 private:
  using Columns = std::vector<kernels::FootprintColumn>;
  template <typename Flips>
  [[nodiscard]] bool toolReads(const Eigen::Vector3f& position_L, int d, const Flips& flips, FlipKind kind) const;
  template <typename Flips>
  [[nodiscard]] bool armReads(const Eigen::Vector3f& position_L, int d, const Flips& flips, FlipKind kind) const;

  kernels::ToolKernelView tool_;
  kernels::ApproachView approach_;
  float inverse_voxel_size_;
  Columns tool_columns_, arm_columns_;
  Index3 low_ = {}, high_ = {};  ///< box of all columns, relative to the first leaf
};

}  // namespace accessvdb::internal
