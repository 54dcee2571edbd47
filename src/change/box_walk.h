// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The boxes of a regular grid that a ray crosses, one after the other.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace accessvdb::internal {

/// A ray from the sensor, in voxels; voxel n is [n, n + 1) along each axis.
struct VoxelRay {
  std::array<double, 3> from;
  std::array<double, 3> along;  ///< unit
};

/// Calls visit(box, begin, end) with the box's index and the part of the ray inside, in order.
/// @param edge  of the boxes, voxels  @param begin, end  the part of the ray that counts, voxels from the sensor
template <typename Visit>
void forEachBox(const VoxelRay& ray, int edge, double begin, double end, const Visit& visit) {
  if (!(begin < end)) return;
  std::array<std::int32_t, 3> box;
  std::array<double, 3> next, step;
  const double size = edge;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double u = ray.along[axis], x = ray.from[axis] + begin * u;
    box[axis] = static_cast<std::int32_t>(std::floor(x / size));
    if (u == 0) {
      next[axis] = step[axis] = std::numeric_limits<double>::infinity();
      continue;
    }
    const double face = size * (box[axis] + (u > 0 ? 1 : 0));
    next[axis] = (face - ray.from[axis]) / u;
    step[axis] = size / std::abs(u);
  }
  double at = begin;
  for (;;) {
    const std::size_t axis = next[0] <= next[1] ? (next[0] <= next[2] ? 0 : 2) : (next[1] <= next[2] ? 1 : 2);
    const double leaves = std::min(next[axis], end);
    if (leaves > at) {
      visit(box, at, leaves);
      at = leaves;
    }
    if (!(next[axis] < end)) return;
    box[axis] += ray.along[axis] > 0 ? 1 : -1;
    next[axis] += step[axis];
  }
}

}  // namespace accessvdb::internal
