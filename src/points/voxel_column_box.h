// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is limited in x and y alone: tiles, and what they need around them.
#pragma once

#include <array>
#include <cstdint>

#include "points/surface_index.h"

namespace accessvdb::internal {

/// A box of voxels, unbounded in z: low <= ijk < high.
struct VoxelColumnBox {
  std::array<std::int32_t, 2> low, high;
  [[nodiscard]] bool contains(const Index3& voxel) const {
    return voxel[0] >= low[0] && voxel[0] < high[0] && voxel[1] >= low[1] && voxel[1] < high[1];
  }
};

}  // namespace accessvdb::internal
