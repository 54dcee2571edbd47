// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The space that the sensor's platform fills while it scans, which is free of everything else.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "tsdf/packed_map.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

struct PlatformBalls {
  std::vector<ReturnRay> balls;  ///< one for each voxel with a sensor position
  std::size_t contradicted = 0;  ///< further ones, in which something collides, or a return of the scan lies
};

/// @param rays  of the returns  @param q_L  [n] or [1] sensor positions in the local frame
[[nodiscard]] PlatformBalls platformBalls(const PackedMap& map, const RegionShape& shape,
                                          std::span<const ReturnRay> rays, std::span<const Eigen::Vector3f> q_L);

}  // namespace accessvdb::internal
