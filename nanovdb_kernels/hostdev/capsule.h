// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A capsule (a segment with a radius: a link of a robot arm, or its path) against the voxels of a map: which leaves it
/// can touch, how far a voxel is from its axis, and where along the axis a voxel is reached first.
///
/// Lengths are in voxels. A voxel counts as touched if its centre is within radius + half a cell's diagonal of the
/// axis, so that no cell is missed that the capsule enters.
#pragma once

#include <cmath>
#include <cstdint>

#include "occupancy_query.h"

namespace accessvdb::kernels {

/// From the centre of a voxel's cell to its corner, rounded up.
inline constexpr float kHalfCellDiagonal = 0.86602546f;
/// Positions farther from the local origin than this have no voxel.
inline constexpr double kMostVoxelsFromOrigin = 1e6;
/// Longest capsule: float32 keeps its positions accurate to 0.004 voxels.
inline constexpr double kMostCapsuleVoxels = 32768;
/// Most leaves in a capsule's box.
inline constexpr double kMostCapsuleLeaves = 1 << 20;

/// False for NaN, infinity, and positions too far out.
ACCESSVDB_HOSTDEV inline bool hasVoxel(const double* p_L, double inverse_voxel_size) {
  for (int axis = 0; axis < 3; ++axis) {
    const double x = p_L[axis] * inverse_voxel_size;
    if (!(x <= kMostVoxelsFromOrigin && x >= -kMostVoxelsFromOrigin)) return false;
  }
  return true;
}

/// Positions are relative to the voxel `anchor`, so that float32 is enough anywhere in the map.
struct Capsule {
  std::int32_t anchor[3] = {0, 0, 0};
  float start[3] = {0, 0, 0};  ///< from the anchor's centre
  float along[3] = {0, 0, 0};  ///< from the start to the end of the axis
  float length2 = 0;           ///< squared
  float radius = 0;
};

/// @param a_L, b_L  ends of the axis, metres    @param radius_m  >= 0
/// @return false if an end has no voxel, the radius is negative or not finite, or the capsule is too large
ACCESSVDB_HOSTDEV inline bool makeCapsule(const double* a_L, const double* b_L, double radius_m,
                                          float inverse_voxel_size, Capsule& capsule) {
  const double per_voxel = inverse_voxel_size;
  const double radius = radius_m * per_voxel;
  if (!hasVoxel(a_L, per_voxel) || !hasVoxel(b_L, per_voxel)) return false;
  if (!(radius >= 0 && radius <= kMostCapsuleVoxels)) return false;
  double length2 = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double start = a_L[axis] * per_voxel, end = b_L[axis] * per_voxel;
    const double whole = floor(start + 0.5);
    capsule.anchor[axis] = static_cast<std::int32_t>(whole);
    capsule.start[axis] = static_cast<float>(start - whole);
    capsule.along[axis] = static_cast<float>(end - start);
    length2 += (end - start) * (end - start);
  }
  capsule.length2 =
      capsule.along[0] * capsule.along[0] + capsule.along[1] * capsule.along[1] + capsule.along[2] * capsule.along[2];
  capsule.radius = static_cast<float>(radius);
  const double length = sqrt(length2), across = (2 * radius + 2) / 8 + 2;
  return length <= kMostCapsuleVoxels && (length / 8 + across) * across * across <= kMostCapsuleLeaves;
}

/// A voxel relative to the axis.
struct AxisPoint {
  float t = 0;          ///< parameter of the nearest point of the axis, 0 at its start, 1 at its end
  float distance2 = 0;  ///< squared distance to that point
};

ACCESSVDB_HOSTDEV inline AxisPoint nearestOnAxis(const Capsule& capsule, float x, float y, float z) {
  const float rx = x - capsule.start[0], ry = y - capsule.start[1], rz = z - capsule.start[2];
  const float dot = rx * capsule.along[0] + ry * capsule.along[1] + rz * capsule.along[2];
  AxisPoint nearest;
  if (dot > 0) nearest.t = dot < capsule.length2 ? dot / capsule.length2 : 1.0f;
  const float ex = rx - nearest.t * capsule.along[0], ey = ry - nearest.t * capsule.along[1],
              ez = rz - nearest.t * capsule.along[2];
  nearest.distance2 = ex * ex + ey * ey + ez * ez;
  return nearest;
}

/// Smallest t at which the axis is within `reach` of a voxel that it does approach that closely.
ACCESSVDB_HOSTDEV inline float firstWithin(const Capsule& capsule, float x, float y, float z, float reach) {
  const float rx = x - capsule.start[0], ry = y - capsule.start[1], rz = z - capsule.start[2];
  const float reach2 = reach * reach;
  if (!(capsule.length2 > 0) || rx * rx + ry * ry + rz * rz <= reach2) return 0;
  // From the foot of the perpendicular back by half the chord. The usual formula subtracts large numbers, which causes
  // errors of several voxels on long axes.
  const float foot = (rx * capsule.along[0] + ry * capsule.along[1] + rz * capsule.along[2]) / capsule.length2;
  const float ex = rx - foot * capsule.along[0], ey = ry - foot * capsule.along[1], ez = rz - foot * capsule.along[2];
  const float chord2 = reach2 - (ex * ex + ey * ey + ez * ez);
  const float t = foot - (chord2 > 0 ? sqrtf(chord2 / capsule.length2) : 0.0f);
  return t < 0 ? 0.0f : t > 1 ? 1.0f : t;
}

/// Walks the leaves that a capsule can touch, slab by slab along its dominant axis.
///   for (CapsuleLeaves leaves(capsule); leaves.next(origin);) ...
class CapsuleLeaves {
 public:
  ACCESSVDB_HOSTDEV explicit CapsuleLeaves(const Capsule& capsule)
      : capsule_(capsule), reach_(capsule.radius + kHalfCellDiagonal + kSlack) {
    for (int axis = 1; axis < 3; ++axis) {
      if (fabsf(capsule.along[axis]) > fabsf(capsule.along[major_])) major_ = axis;
    }
    const float begin = capsule.start[major_], end = begin + capsule.along[major_];
    slab_ = leafAt(major_, (begin < end ? begin : end) - reach_) - 1;
    last_slab_ = leafAt(major_, (begin < end ? end : begin) + reach_);
  }

  /// @param origin  out: voxel of the next leaf's lowest corner    @return false if there is none
  ACCESSVDB_HOSTDEV bool next(Coord& origin) {
    while (true) {
      if (v_ < high_[1]) {
        ++v_;
      } else if (u_ < high_[0]) {
        ++u_;
        v_ = low_[1];
      } else if (!nextSlab()) {
        return false;
      }
      std::int32_t leaf[3];
      leaf[major_] = slab_;
      leaf[(major_ + 1) % 3] = u_;
      leaf[(major_ + 2) % 3] = v_;
      origin = Coord(leaf[0] * 8, leaf[1] * 8, leaf[2] * 8);
      const float far = reach_ + kLeafRadius;
      if (nearestOnAxis(capsule_, static_cast<float>(origin[0] - capsule_.anchor[0]) + 3.5f,
                        static_cast<float>(origin[1] - capsule_.anchor[1]) + 3.5f,
                        static_cast<float>(origin[2] - capsule_.anchor[2]) + 3.5f)
              .distance2 <= far * far) {
        return true;
      }
    }
  }

 private:
  static constexpr float kSlack = 0.01f;         // exceeds the rounding error of a position
  static constexpr float kLeafRadius = 6.0622f;  // from a leaf's centre to its farthest voxel centre

  ACCESSVDB_HOSTDEV std::int32_t leafAt(int axis, float x) const {
    return (capsule_.anchor[axis] + static_cast<std::int32_t>(floorf(x))) >> 3;
  }
  /// Steps to the next slab with leaves and finds their box in the other two axes.
  ACCESSVDB_HOSTDEV bool nextSlab() {
    while (++slab_ <= last_slab_) {
      const float low = static_cast<float>(slab_ * 8 - capsule_.anchor[major_]) - reach_ - capsule_.start[major_];
      const float high = static_cast<float>(slab_ * 8 + 7 - capsule_.anchor[major_]) + reach_ - capsule_.start[major_];
      float t0 = 0, t1 = 1;
      if (const float along = capsule_.along[major_]; along != 0) {
        const float ta = low / along, tb = high / along;
        t0 = fmaxf(0.0f, fminf(ta, tb) - kSlack / fabsf(along));
        t1 = fminf(1.0f, fmaxf(ta, tb) + kSlack / fabsf(along));
      }
      if (!(t0 <= t1)) continue;
      for (int n = 0; n < 2; ++n) {
        const int axis = (major_ + 1 + n) % 3;
        const float x0 = capsule_.start[axis] + t0 * capsule_.along[axis],
                    x1 = capsule_.start[axis] + t1 * capsule_.along[axis];
        low_[n] = leafAt(axis, fminf(x0, x1) - reach_);
        high_[n] = leafAt(axis, fmaxf(x0, x1) + reach_);
      }
      u_ = low_[0];
      v_ = low_[1];
      return true;
    }
    return false;
  }

  Capsule capsule_;
  float reach_;
  int major_ = 0;
  std::int32_t slab_ = 0, last_slab_ = 0, u_ = 0, v_ = 0;
  std::int32_t low_[2] = {0, 0}, high_[2] = {-1, -1};
};

}  // namespace accessvdb::kernels
