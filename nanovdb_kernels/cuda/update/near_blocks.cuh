// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Touched points near a block, as those of moved points look for them.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/update_views.cuh"

namespace accessvdb::kernels {

/// A squared distance in float32 is off by less than 5 x 2^-24 of its value, a squared reach by less than 2^-22.
inline constexpr float kReachSlack = 1.000001f;

/// How far the neighbours of a block's points may lie from its voxels. @param reach_m  largest of its points
__device__ inline float blockReachVoxels(const PointsView& points, float reach_m) {
  return reach_m / points.rule.voxel_size_m * kReachSlack + 2 * static_cast<float>(kMeanRoundingVoxels);
}

__device__ inline float squaredDistance(const float* a, const float* b) {
  const float dx = a[0] - b[0], dy = a[1] - b[1], dz = a[2] - b[2];
  return dx * dx + dy * dy + dz * dz;
}

/// Calls visit(block, squared gap in voxels) with every block near a leaf, one block per lane; all lanes call it
/// equally often, with kNoIndex if a lane has none.
template <class Visit>
__device__ void forEachNear(const BlockIndexView& index, const std::int32_t* leaf, float reach_voxels, unsigned lane,
                            const Visit& visit) {
  const int rings = static_cast<int>(reach_voxels / 8) + 1, side = 2 * rings + 1, all = side * side * side;
  for (int base = 0; base < all; base += static_cast<int>(kWarp)) {
    const int n = base + static_cast<int>(lane);
    std::uint32_t block = kNoIndex;
    float squared = 0;
    if (n < all) {
      const int d[3] = {n / (side * side) - rings, n / side % side - rings, n % side - rings};
      for (int axis = 0; axis < 3; ++axis) {
        const int between = (d[axis] < 0 ? -d[axis] : d[axis]) - 1;
        const float gap = between > 0 ? static_cast<float>(between) * 8 : 0;
        squared += gap * gap;
      }
      if (squared <= reach_voxels * reach_voxels) block = index.find(leaf[0] + d[0], leaf[1] + d[1], leaf[2] + d[2]);
    }
    visit(block, squared);
  }
}

}  // namespace accessvdb::kernels
