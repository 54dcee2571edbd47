// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which voxels of a map belong to a region (docs/design/change.md, "By hand").
#pragma once

#include "accessvdb/region.h"
#include "points/point_store.h"
#include "tsdf/removed_voxels.h"

namespace accessvdb::internal {

/// Where a region is looked up.
struct RegionPlace {
  const PackedMap& map;
  const PointStore& points;
  Eigen::Vector3d origin_W;  ///< of the map's local frame
};

/// @throws UnusableInput "region.outside" (nothing observed there), "region.ids"
/// @throws ResourceLimit "region.size" (a mesh of more than 10^8 columns of voxels)
[[nodiscard]] VoxelSet voxelsOf(const Region& region, const RegionPlace& place);

/// Ids of the points whose own voxel is in the set, ascending.
[[nodiscard]] std::vector<std::uint32_t> pointsIn(const VoxelSet& voxels, const PointStore& points);

}  // namespace accessvdb::internal
