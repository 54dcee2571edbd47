// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A return with its ray, as the map sees it and as one leaf sees it; in voxels.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Interval of leaf-relative offsets e along one axis.
struct Interval {
  float low, high;
  [[nodiscard]] ACCESSVDB_HOSTDEV bool empty() const { return !(low <= high); }
};

/// One return with its ray, relative to a voxel near it, so that float32 keeps its precision anywhere in the map.
struct alignas(16) ReturnRay {
  std::int32_t base_ijk[3];  ///< voxel of the return
  float offset[3];           ///< return minus base_ijk, in voxels, within +-0.5
  float to_sensor[3];        ///< [u] unit
  float range;               ///< [R] in voxels
  Interval cone_x, band_x;   ///< extents of its regions
  std::uint32_t news;        ///< 1: it contradicts the map (vote_rule.h); else 0
};

/// A return that reaches into a leaf: its index, and which part of its region reaches it.
struct LeafEntry {
  /// Line: of its ray beyond the band. Ball: around it; it is a sensor position, and no return.
  static constexpr std::uint32_t kCone = 0, kBand = 1, kLine = 2, kBall = 3;
  std::uint32_t code = 0;  ///< index << 2 | part
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t index() const { return code >> 2; }
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t part() const { return code & 3; }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool cone() const { return part() == kCone; }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool band() const { return part() == kBand; }
};

/// One return as seen from one leaf, in voxels.
struct ReturnInLeaf {
  float leaf[3];       ///< lowest voxel of the leaf minus the return's voxel
  float offset[3];     ///< return minus its voxel
  float to_sensor[3];  ///< [u]
  float range;         ///< [R]
  Interval box_x;      ///< extent of the region
};

/// @param origin_ijk  [3] lowest voxel of the leaf
ACCESSVDB_HOSTDEV inline ReturnInLeaf seenFrom(const std::int32_t* origin_ijk, const ReturnRay& ray, bool band) {
  ReturnInLeaf local;
  for (int axis = 0; axis < 3; ++axis) {
    local.leaf[axis] = static_cast<float>(origin_ijk[axis] - ray.base_ijk[axis]);
    local.offset[axis] = ray.offset[axis];
    local.to_sensor[axis] = ray.to_sensor[axis];
  }
  local.range = ray.range;
  local.box_x = band ? ray.band_x : ray.cone_x;
  return local;
}

/// Voxel of a thin band at s along the ray, along one axis, relative to the return's voxel.
ACCESSVDB_HOSTDEV inline std::int32_t thinBandVoxel(const ReturnRay& ray, float s, int axis) {
  return static_cast<std::int32_t>(floorf(ray.offset[axis] + s * ray.to_sensor[axis] + 0.5f));
}

/// The voxels along a ray between two distances from its return: one in each layer across the axis that the ray is
/// nearest to. In steps of 2^-32 voxels, so that each can be named without those before it.
struct ClearedLine {
  std::int64_t first[3], step[3];  ///< of the voxel, relative to the return's, plus a half
  int axis;                        ///< step is a voxel along this one
  std::int32_t count;              ///< voxels 1 .. count

  /// @param begin, end  in voxels along the ray; not beyond the sensor
  ACCESSVDB_HOSTDEV ClearedLine(const ReturnRay& ray, float begin, float end) : axis(0) {
    constexpr double kSteps = 4294967296.0;
    if (fabsf(ray.to_sensor[1]) > fabsf(ray.to_sensor[axis])) axis = 1;
    if (fabsf(ray.to_sensor[2]) > fabsf(ray.to_sensor[axis])) axis = 2;
    const double most = fabs(static_cast<double>(ray.to_sensor[axis]));
    const double length = static_cast<double>(end < ray.range ? end : ray.range) - static_cast<double>(begin);
    count = length > 0 ? static_cast<std::int32_t>(length * most) : 0;
    for (int a = 0; a < 3; ++a) {
      const double u = static_cast<double>(ray.to_sensor[a]);
      first[a] = static_cast<std::int64_t>((static_cast<double>(ray.offset[a]) + static_cast<double>(begin) * u + 0.5) *
                                           kSteps);
      step[a] = static_cast<std::int64_t>(u / most * kSteps);
    }
  }
  /// Relative to the return's voxel.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int32_t voxel(std::int32_t n, int a) const {
    return static_cast<std::int32_t>((first[a] + n * step[a]) >> 32);
  }
};

/// The part of a line in the layers of a leaf: voxels first .. last, maybe none.
struct LineLayers {
  std::int32_t first, last;
  /// @param low  lowest voxel of the leaf along the line's axis, relative to the return's
  ACCESSVDB_HOSTDEV LineLayers(const ClearedLine& line, std::int32_t low) {
    const std::int32_t zero = line.voxel(0, line.axis);
    const bool up = line.step[line.axis] > 0;
    first = up ? low - zero : zero - (low + 7);
    last = first + 7;
    if (first < 1) first = 1;
    if (last > line.count) last = line.count;
  }
};

/// Voxel of a line in a leaf, 0 .. 511, or -1 if it is in another. @param origin_ijk  [3] lowest voxel of the leaf
ACCESSVDB_HOSTDEV inline int lineVoxelIn(const std::int32_t* origin_ijk, const ReturnRay& ray, const ClearedLine& line,
                                         std::int32_t n) {
  int voxel = 0;
  for (int a = 0; a < 3; ++a) {
    const std::int32_t local = line.voxel(n, a) - (origin_ijk[a] - ray.base_ijk[a]);
    if (local < 0 || local > 7) return -1;
    voxel = voxel << 3 | local;
  }
  return voxel;
}

/// Whether a voxel's centre is in a ball around a position. @param origin_ijk  [3] lowest voxel of its leaf
/// @param voxel  0 .. 511
ACCESSVDB_HOSTDEV inline bool isInBall(const std::int32_t* origin_ijk, int voxel, const ReturnRay& centre,
                                       float radius_squared) {
  float sum = 0;
  for (int a = 0; a < 3; ++a) {
    const int local = voxel >> (6 - 3 * a) & 7;
    const float e = static_cast<float>(origin_ijk[a] - centre.base_ijk[a] + local) - centre.offset[a];
    sum += e * e;
  }
  return sum <= radius_squared;
}

/// Slack of the conservative bounds against rounding, in voxels.
inline constexpr float kSlack = 1e-3f;
/// Radius of the ball around the return that is always updated (|x-p| <= v), in voxels.
inline constexpr float kOwnVoxelRadius = 1.0f;

}  // namespace accessvdb::kernels
