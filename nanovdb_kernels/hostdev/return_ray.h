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
  static constexpr std::uint32_t kBand = 1;
  std::uint32_t code = 0;  ///< index << 1 | kBand
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint32_t index() const { return code >> 1; }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool band() const { return (code & kBand) != 0; }
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

/// Slack of the conservative bounds against rounding, in voxels.
inline constexpr float kSlack = 1e-3f;
/// Radius of the ball around the return that is always updated (|x-p| <= v), in voxels.
inline constexpr float kOwnVoxelRadius = 1.0f;

}  // namespace accessvdb::kernels
