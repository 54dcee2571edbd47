// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which leaves around a point each direction reads: the exact filter in front of re-testing.
#pragma once

#include <span>
#include <vector>

#include "hostdev/views.h"
#include "points/flip_set.h"
#include "points/point_store.h"

namespace accessvdb::internal {

/// Directions of a block of points that may be affected by flips, at leaf resolution.
struct AffectedDirections {
  DirectionMask better = {};  ///< a flip that can only help lies in a leaf that the direction reads
  DirectionMask worse = {};   ///< a flip that can only hurt
};

class LeafFootprint {
 public:
  /// @param tool, approach  host-side tables
  LeafFootprint(const kernels::ToolKernelView& tool, const kernels::ApproachView& approach, double voxel_size_m);

  /// For all points of a block, wherever in it they lie. Conservative.
  [[nodiscard]] AffectedDirections affected(const Index3& block_leaf, const FlipSet& flips) const;

  /// Voxel-exact: does direction d, tried from this point, read a voxel whose fact flipped for the better / worse?
  [[nodiscard]] bool readsBetter(const Eigen::Vector3f& position_L, int d, const FlipSet& flips) const;
  [[nodiscard]] bool readsWorse(const Eigen::Vector3f& position_L, int d, const FlipSet& flips) const;

 private:
  /// Leaves at one horizontal offset from the point's leaf.
  struct Column {
    std::int32_t dx, dy, z_low, z_high;
    DirectionMask directions;
  };
  using Columns = std::vector<Column>;
  template <typename Pick>
  [[nodiscard]] bool toolReads(const Eigen::Vector3f& position_L, int d, const FlipSet& flips, const Pick& pick) const;
  template <typename Pick>
  [[nodiscard]] bool armReads(const Eigen::Vector3f& position_L, int d, const FlipSet& flips, const Pick& pick) const;

  kernels::ToolKernelView tool_;
  kernels::ApproachView approach_;
  float inverse_voxel_size_;
  Columns tool_columns_, arm_columns_;
};

}  // namespace accessvdb::internal
