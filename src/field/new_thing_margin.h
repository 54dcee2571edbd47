// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How far from every known surface a thing has to be to count as new.
#pragma once

#include <algorithm>

#include "accessvdb/params.h"

namespace accessvdb::internal {

/// Returns of a known surface scatter by the range noise, and its voxels by their size: nearer returns are no news.
inline constexpr double kMarginVoxels = 2, kMarginSigmas = 3;

[[nodiscard]] inline double farFromSurfaces_m(const FieldParams& resolved) {
  const TsdfParams& t = resolved.tsdf;
  return resolved.scoring.collision_distance_m +
         std::max(kMarginVoxels * t.voxel_size_m, kMarginSigmas * t.range_noise_m);
}

}  // namespace accessvdb::internal
