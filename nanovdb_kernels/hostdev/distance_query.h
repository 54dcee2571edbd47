// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the distance mirror says about a position. Unobserved is NaN, never a distance.
#pragma once

#include <cmath>
#include <limits>

#include "capsule.h"
#include "position_voxel.h"

namespace accessvdb::kernels {

/// The map's distances: value = metres, active = observed. No grid: nothing is known.
struct DistanceView {
  const DistanceGrid* grid = nullptr;
  float inverse_voxel_size = 0;  ///< [1/m]
};
static_assert(std::is_trivially_copyable_v<DistanceView>);

inline constexpr float kNoDistance = std::numeric_limits<float>::quiet_NaN();

/// Distance at the voxel that contains p_L: the same voxel that occupancyAt() reads.
/// @param p_L  metres, local frame  @return metres; NaN: never observed, or it has no voxel
ACCESSVDB_HOSTDEV inline float distanceAt(const DistanceView& map, const double* p_L) {
  if (map.grid == nullptr || !hasVoxel(p_L, map.inverse_voxel_size)) return kNoDistance;
  const nanovdb::DefaultReadAccessor<float> reader(map.grid->tree().root());
  float distance_m = 0;
  const bool observed = reader.probeValue(voxelOfPosition(p_L, map.inverse_voxel_size), distance_m);
  return observed ? distance_m : kNoDistance;
}

/// Trilinear between the eight voxels whose centres surround p_L, along z, then y, then x.
/// @return metres; NaN if one of them was never observed or p_L has no voxel
ACCESSVDB_HOSTDEV inline float distanceInterpolatedAt(const DistanceView& map, const double* p_L) {
  if (map.grid == nullptr || !hasVoxel(p_L, map.inverse_voxel_size)) return kNoDistance;
  std::int32_t low[3] = {0, 0, 0};
  float part[3] = {0, 0, 0};
  for (int axis = 0; axis < 3; ++axis) {
    const double x = p_L[axis] * static_cast<double>(map.inverse_voxel_size), whole = floor(x);
    low[axis] = static_cast<std::int32_t>(whole);
    part[axis] = static_cast<float>(x - whole);
  }
  const nanovdb::DefaultReadAccessor<float> reader(map.grid->tree().root());
  const auto between = [](float a, float b, float t) { return a + t * (b - a); };
  float along_x[2] = {0, 0};
  for (int i = 0; i < 2; ++i) {
    float along_y[2] = {0, 0};
    for (int j = 0; j < 2; ++j) {
      float along_z[2] = {0, 0};
      for (int k = 0; k < 2; ++k) {
        if (!reader.probeValue(Coord(low[0] + i, low[1] + j, low[2] + k), along_z[k])) return kNoDistance;
      }
      along_y[j] = between(along_z[0], along_z[1], part[2]);
    }
    along_x[i] = between(along_y[0], along_y[1], part[1]);
  }
  return between(along_x[0], along_x[1], part[0]);
}

}  // namespace accessvdb::kernels
