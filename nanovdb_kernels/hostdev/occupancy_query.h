// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading the map: which voxel a position lies in, and the two facts of a voxel.
#pragma once

#include <cmath>

#include "views.h"

namespace accessvdb::kernels {

using Coord = nanovdb::Coord;

/// Index of the voxel that contains a coordinate: voxel i is centred at i * v (OpenVDB's convention). The only function
/// that maps points to voxels; also used when points are stored.
ACCESSVDB_HOSTDEV inline std::int32_t voxelIndex(float x_m, float inverse_voxel_size) {
  return static_cast<std::int32_t>(floorf(x_m * inverse_voxel_size + 0.5f));
}
ACCESSVDB_HOSTDEV inline Coord voxelOf(float x_m, float y_m, float z_m, float inverse_voxel_size) {
  return Coord(voxelIndex(x_m, inverse_voxel_size), voxelIndex(y_m, inverse_voxel_size),
               voxelIndex(z_m, inverse_voxel_size));
}

/// Cached reads; one reader per evaluation, never shared between threads.
class OccupancyReader {
 public:
  ACCESSVDB_HOSTDEV explicit OccupancyReader(const OccupancyView& view) : accessor_(view.grid->tree().root()) {}

  /// Observed and nearer than r_c to a surface. Unknown is free (paper, "Tool kernel").
  ACCESSVDB_HOSTDEV bool collides(const Coord& ijk) const { return accessor_.getValue(ijk); }
  /// Observed and free, or cleared. Unknown is occupied (paper, "Arm path checking").
  ACCESSVDB_HOSTDEV bool armFree(const Coord& ijk) const { return accessor_.isActive(ijk); }

  /// The leaf of a voxel, or nullptr: all unknown.
  ACCESSVDB_HOSTDEV const OccupancyLeaf* leafAt(const Coord& ijk) const { return accessor_.probeLeaf(ijk); }

  /// Colliding voxels among (x, y, z8 .. z8 + 7), bit i = z8 + i; z8 is a multiple of 8.
  ACCESSVDB_HOSTDEV std::uint32_t collidesRow(const Coord& ijk) const {
    const OccupancyLeaf* leaf = leafAt(ijk);
    if (leaf == nullptr) return 0;
    const auto* words = reinterpret_cast<const std::uint64_t*>(&leaf->data()->mValues);
    return static_cast<std::uint32_t>(words[ijk[0] & 7] >> ((ijk[1] & 7) * 8)) & 0xffu;
  }

 private:
  nanovdb::DefaultReadAccessor<bool> accessor_;
};

}  // namespace accessvdb::kernels
