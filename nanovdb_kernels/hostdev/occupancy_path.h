// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the mirrored map says about a position and along a capsule. Bad data is never free.
#pragma once

#include "capsule.h"
#include "position_voxel.h"

namespace accessvdb::kernels {

/// A voxel's state in the mirror. Every voxel has exactly one.
enum class Occupancy : std::uint8_t {
  Unknown = 0,  ///< never observed and never cleared; also any position without a voxel
  Free = 1,     ///< observed and at least r_c from a surface, or cleared
  Collides = 2  ///< observed and nearer than r_c to a surface
};

/// State of one voxel. The reader belongs to one evaluation and is never shared between threads.
ACCESSVDB_HOSTDEV inline Occupancy occupancyOf(const OccupancyReader& reader, const Coord& ijk) {
  if (reader.collides(ijk)) return Occupancy::Collides;
  return reader.armFree(ijk) ? Occupancy::Free : Occupancy::Unknown;
}

/// @param p_L  metres, local frame
ACCESSVDB_HOSTDEV inline Occupancy occupancyAt(const OccupancyView& map, const double* p_L) {
  if (!hasVoxel(p_L, map.inverse_voxel_size)) return Occupancy::Unknown;
  const OccupancyReader reader(map);
  return occupancyOf(reader, voxelOfPosition(p_L, map.inverse_voxel_size));
}

/// What a capsule touches.
struct PathOccupancy {
  bool collision = false;  ///< it touches a colliding voxel
  bool unknown = true;     ///< it touches an unknown voxel, or it was not walked
  bool valid = false;      ///< false: bad position or radius, or too large; nothing was walked
  float first_hit_t = -1;  ///< where along the axis, 0 .. 1, the first colliding voxel is touched; -1 = nowhere
  /// Whether every voxel that it touches was seen to be free.
  ACCESSVDB_HOSTDEV bool free() const { return valid && !collision && !unknown; }
};

/// @param a_L, b_L  ends of the axis, metres, local frame
ACCESSVDB_HOSTDEV inline PathOccupancy occupancyAlong(const OccupancyView& map, const double* a_L, const double* b_L,
                                                      double radius_m) {
  PathOccupancy path;
  Capsule capsule;
  if (!makeCapsule(a_L, b_L, radius_m, map.inverse_voxel_size, capsule)) return path;
  path.valid = true;
  path.unknown = false;
  const OccupancyReader reader(map);
  const float reach = capsule.radius + kHalfCellDiagonal, reach2 = reach * reach;
  CapsuleLeaves leaves(capsule);
  Coord origin;
  while (leaves.next(origin)) {
    const OccupancyLeaf* leaf = reader.leafAt(origin);
    if (leaf == nullptr && path.unknown) continue;
    for (std::uint32_t n = 0; n < 512; ++n) {
      if (leaf == nullptr && path.unknown) break;
      const float x = static_cast<float>(origin[0] + static_cast<std::int32_t>(n >> 6) - capsule.anchor[0]);
      const float y = static_cast<float>(origin[1] + static_cast<std::int32_t>(n >> 3 & 7) - capsule.anchor[1]);
      const float z = static_cast<float>(origin[2] + static_cast<std::int32_t>(n & 7) - capsule.anchor[2]);
      if (nearestOnAxis(capsule, x, y, z).distance2 > reach2) continue;
      if (leaf == nullptr) {
        path.unknown = true;
      } else if (leaf->getValue(n)) {
        const float t = firstWithin(capsule, x, y, z, reach);
        if (!path.collision || t < path.first_hit_t) path.first_hit_t = t;
        path.collision = true;
      } else if (!leaf->isActive(n)) {
        path.unknown = true;
      }
    }
  }
  return path;
}

}  // namespace accessvdb::kernels
