// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/surface_columns.h"

#include <algorithm>

#include "points/ids_in_box.h"

namespace accessvdb::internal {

kernels::SurfaceChoice surfaceChoice(const FieldParams& resolved) {
  const double spacing_m = resolved.scoring.point_spacing_m;
  if (!(spacing_m > 0)) return {};
  // Noise of a few sigma, or a surface that crosses a cell at an angle; no farther than a return tells of a surface.
  const double window_m =
      std::min(std::max(2 * resolved.tsdf.range_noise_m, spacing_m), resolved.tsdf.truncation_distance_m);
  return kernels::SurfaceChoice::of(resolved.tsdf.voxel_size_m, spacing_m, window_m);
}

kernels::CompetingPoint SurfaceColumns::competing(std::uint32_t id, int axis) const {
  const Index3 voxel = points_.voxelOf(points_.first_L(id));
  return {choice_.heightOf(points_.pca_L(id)[axis]), points_.returns(id), {voxel[0], voxel[1], voxel[2]}};
}

bool SurfaceColumns::isOnSurface(std::uint32_t id, int axis) {
  const kernels::CompetingPoint own = competing(id, axis);
  const kernels::CompetingVoxels box(choice_, own.voxel, axis);
  const Index3 low = {box.low[0], box.low[1], box.low[2]}, high = {box.high[0], box.high[1], box.high[2]};
  const SurfaceIndex& index = points_.index();
  ids_.clear();
  index.forEachBlock(parentOf(low), parentOf(high), [&](std::uint32_t b) {
    forEachIdInBox(index.blocks()[b], low, high, [this](std::uint32_t near) { ids_.push_back(near); });
  });
  if (ids_.size() == 1) return true;
  for (const std::uint32_t near : ids_) points_.prefetch(near);
  const bool front = isInFront(id, axis);
  found_.clear();
  for (const std::uint32_t near : ids_) {
    if (isInFront(near, axis) == front) found_.push_back(competing(near, axis));
  }
  return kernels::isOnSurface(own, choice_.window, [this](const auto& visit) {
    for (const kernels::CompetingPoint& point : found_) visit(point);
  });
}

}  // namespace accessvdb::internal
