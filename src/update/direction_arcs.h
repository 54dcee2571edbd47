// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inverse of the tool kernel: which yaw directions cover a voxel at an offset from a point? Nearly always those of
/// one arc, and of a flat tool the same ones for most voxels above each other (hostdev/known_counts.h).
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"
#include "launch/exact_updater.h"

namespace accessvdb::internal {

class DirectionArcs {
 public:
  /// Bounds that follow flips pay as long as a column of voxels has few arcs; thick round tools have more.
  static constexpr double kMostArcsPerColumn = 4;

  /// Empty for tools that roll, for those tested by samples (their voxels depend on where in its voxel the point lies),
  /// for limits that bounds do not reach, and where tables would have too many entries.
  /// @param num_directions  yaws in order
  DirectionArcs(const kernels::ToolKernelView& tool, int num_directions);

  [[nodiscard]] kernels::ArcsTable table() const { return {table_, more_, shape_}; }

 private:
  std::vector<kernels::ArcsOfColumn> table_;
  std::vector<kernels::CoveringArc> more_;
  kernels::ArcsView shape_;
};

}  // namespace accessvdb::internal
