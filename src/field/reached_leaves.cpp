// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/reached_leaves.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <vector>

#include "tsdf/return_region.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kReturnsPerTask = 256;
/// Margin beyond `reach` against rounding, in voxels.
constexpr float kOwnSlack = 0.01f;
/// The widest cone that RegionSlices bounds.
constexpr float kMostSinSquared = 0.32f;

}  // namespace

bool forEachReachedLeaf(const TsdfParams& resolved, std::span<const Eigen::Vector3f> p_L,
                        std::span<const Eigen::Vector3f> q_L, int reach, const TakeLeaves& take) {
  if (resolved.region == UpdateRegion::Projective) return false;
  RegionShape shape(resolved);
  // Beyond the slopes that RegionSlices bounds, whole leaves around a wide cone's middle may be written: use the cube.
  if (shape.cone_sin_squared > kMostSinSquared) shape.full_cube = true;
  const float margin = static_cast<float>(reach) + kOwnSlack;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, p_L.size(), kReturnsPerTask), [&](const auto& range) {
    std::vector<Index3> leaves;
    leaves.reserve(kReturnsPerTask * 12);
    for (std::size_t n = range.begin(); n != range.end(); ++n) {
      const ReturnRay ray = makeRay(p_L[n].data(), q_L[q_L.size() == 1 ? 0 : n].data(), resolved.voxel_size_m);
      const kernels::RegionSlices slices(shape, ray);
      kernels::visitLayers(
          slices, ray, slices.coneAlong(), margin,
          [&](Interval slice, int axis) { return slices.coneAcross(slice, axis); },
          [&](const std::int32_t* leaf) {
            leaves.push_back({leaf[0], leaf[1], leaf[2]});
          });
    }
    take(leaves);
  });
  return true;
}

}  // namespace accessvdb::internal
