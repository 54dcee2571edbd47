// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/reached_leaves.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tsdf/return_region.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kReturnsPerTask = 256;
/// Margin beyond `reach` against rounding, in voxels.
constexpr float kOwnSlack = 0.01f;
/// The widest cone that RegionSlices bounds.
constexpr float kMostSinSquared = 0.32f;

struct LeafSpan {
  std::int32_t first, last;
};

/// Leaves of the voxels whose centres have offsets in [low - margin, high + margin] from the return.
LeafSpan leafSpan(const ReturnRay& ray, int axis, Interval offsets, float margin) {
  const auto a = static_cast<std::size_t>(axis);
  const float low = std::ceil(offsets.low - margin + ray.offset[a]);
  const float high = std::floor(offsets.high + margin + ray.offset[a]);
  return {(ray.base_ijk[a] + static_cast<std::int32_t>(low)) >> 3,
          (ray.base_ijk[a] + static_cast<std::int32_t>(high)) >> 3};
}

/// The leaves of the cone's part of the region, layer by layer across the ray's dominant axis.
void addLeaves(const RegionSlices& slices, const ReturnRay& ray, float margin, std::vector<Index3>& leaves) {
  const int a = slices.dominantAxis(), b = slices.axisB(), c = slices.axisC();
  const Interval along = slices.coneAlong();
  const LeafSpan layers = leafSpan(ray, a, along, margin);
  Index3 leaf;
  const auto at = [](int axis) { return static_cast<std::size_t>(axis); };
  for (std::int32_t layer = layers.first; layer <= layers.last; ++layer) {
    // Voxels of this layer of leaves, and those at most `margin` from them, along the axis.
    const float first = static_cast<float>(layer * 8 - ray.base_ijk[at(a)]) - ray.offset[at(a)];
    const Interval slice = {std::max(along.low, first - margin), std::min(along.high, first + 7 + margin)};
    if (slice.empty()) continue;
    const LeafSpan rows = leafSpan(ray, b, slices.coneAcross(slice, 0), margin);
    const LeafSpan columns = leafSpan(ray, c, slices.coneAcross(slice, 1), margin);
    leaf[at(a)] = layer;
    for (leaf[at(b)] = rows.first; leaf[at(b)] <= rows.last; ++leaf[at(b)]) {
      for (leaf[at(c)] = columns.first; leaf[at(c)] <= columns.last; ++leaf[at(c)]) leaves.push_back(leaf);
    }
  }
}

}  // namespace

bool forEachReachedLeaf(const TsdfParams& resolved, std::span<const Eigen::Vector3f> p_L,
                        std::span<const Eigen::Vector3f> q_L, int reach, const TakeLeaves& take) {
  if (resolved.region == UpdateRegion::Projective) return false;
  RegionShape shape(resolved);
  // Beyond the slopes that RegionSlices bounds, whole leaves around a wide cone's middle may be written: use the cube.
  if (shape.cone_sin_squared > kMostSinSquared) shape.region = UpdateRegion::FullCube;
  const float margin = static_cast<float>(reach) + kOwnSlack;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), kReturnsPerTask), [&](const auto& range) {
    std::vector<Index3> leaves;
    leaves.reserve(kReturnsPerTask * 12);
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const ReturnRay ray = makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), resolved.voxel_size_m);
      addLeaves(RegionSlices(shape, ray), ray, margin, leaves);
    }
    take(leaves);
  });
  return true;
}

}  // namespace accessvdb::internal
