// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/return_region.h"

namespace accessvdb::internal {

RegionShape::RegionShape(const TsdfParams& p)
    : region(p.region),
      tau(static_cast<float>(p.truncation_distance_m / p.voxel_size_m)),
      cone_cos(static_cast<float>(p.cone_cos_min)),
      cone_cos_squared(static_cast<float>(p.cone_cos_min * p.cone_cos_min)),
      cone_sin_squared(static_cast<float>(1.0 - p.cone_cos_min * p.cone_cos_min)),
      band_begin(static_cast<float>(p.cleared_begin_tau * p.truncation_distance_m / p.voxel_size_m)),
      band_end(static_cast<float>(p.cleared_end_tau * p.truncation_distance_m / p.voxel_size_m)),
      band_radius(static_cast<float>(p.cleared_radius_voxels)) {}

}  // namespace accessvdb::internal
