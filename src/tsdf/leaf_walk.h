// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The leaves that a part of a return's region reaches, layer by layer across the ray's dominant axis.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// std::floor() is a call on x86-64 without SSE4.1.
inline std::int32_t floorToInt(float value) {
  const auto n = static_cast<std::int32_t>(value);
  return n - (static_cast<float>(n) > value ? 1 : 0);
}

/// First and last leaf along an axis.
struct LeafSpan {
  std::int32_t first, last;
};

/// Leaves of the voxels whose centres have offsets in [low - margin, high + margin] from the return.
inline LeafSpan leafSpan(const ReturnRay& ray, int axis, Interval offsets, float margin) {
  const auto a = static_cast<std::size_t>(axis);
  const std::int32_t low = -floorToInt(-(offsets.low - margin + ray.offset[a]));
  const std::int32_t high = floorToInt(offsets.high + margin + ray.offset[a]);
  return {(ray.base_ijk[a] + low) >> 3, (ray.base_ijk[a] + high) >> 3};
}

/// Visits the leaves of a cube around ballAround(). @param visit  (leaf ijk >> 3)
template <typename Visit>
void forEachLeafAround(const ReturnRay& ball, float radius, const Visit& visit) {
  const auto span = [&](int axis) { return leafSpan(ball, axis, {-radius, radius}, kSlack); };
  const LeafSpan x = span(0), y = span(1), z = span(2);
  std::array<std::int32_t, 3> leaf;
  for (leaf[0] = x.first; leaf[0] <= x.last; ++leaf[0]) {
    for (leaf[1] = y.first; leaf[1] <= y.last; ++leaf[1]) {
      for (leaf[2] = z.first; leaf[2] <= z.last; ++leaf[2]) visit(leaf);
    }
  }
}

/// Visits all leaves with a voxel of the part, or one that is at most `margin` voxels from it along each axis.
/// Conservative.
/// @param along  extent of the part along the dominant axis
/// @param across  (slice of `along`, 0 or 1 for axisB() or axisC()) -> extent across it  @param visit  (leaf ijk >> 3)
template <typename Across, typename Visit>
void visitLayers(const RegionSlices& slices, const ReturnRay& ray, Interval along, float margin, const Across& across,
                 const Visit& visit) {
  if (along.empty()) return;
  const auto a = static_cast<std::size_t>(slices.dominantAxis()), b = static_cast<std::size_t>(slices.axisB()),
             c = static_cast<std::size_t>(slices.axisC());
  const LeafSpan layers = leafSpan(ray, slices.dominantAxis(), along, margin);
  for (std::int32_t layer = layers.first; layer <= layers.last; ++layer) {
    // Voxels of this layer of leaves, and those at most `margin` from them, along the axis.
    const float first = static_cast<float>(layer * 8 - ray.base_ijk[a]) - ray.offset[a];
    const Interval slice = {std::max(along.low, first - margin), std::min(along.high, first + 7.0f + margin)};
    if (slice.empty()) continue;
    const LeafSpan rows = leafSpan(ray, slices.axisB(), across(slice, 0), margin);
    const LeafSpan columns = leafSpan(ray, slices.axisC(), across(slice, 1), margin);
    std::array<std::int32_t, 3> leaf;
    leaf[a] = layer;
    for (leaf[b] = rows.first; leaf[b] <= rows.last; ++leaf[b]) {
      for (leaf[c] = columns.first; leaf[c] <= columns.last; ++leaf[c]) visit(leaf);
    }
  }
}

}  // namespace accessvdb::internal
