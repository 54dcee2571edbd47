// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a scan may have raised weights: what the points need to know, without reading the map at each of them.
#pragma once

#include <Eigen/Core>
#include <span>

#include "accessvdb/params.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// Calls take(leaves), voxel index >> 3, for all leaves with a voxel at most `reach` voxels (along each axis) from one
/// to which the scan added a distance sample (docs/PAPER_MAP.md, "Integration"). A superset; a leaf may come several
/// times, and from several threads at once.
/// @param p_L  [n] returns, local frame, metres  @param q_L  [n] or [1] sensor positions
/// @return false, and take is not called, if the region does not follow the returns (the projective baseline)
bool forEachReachedLeaf(const TsdfParams& resolved, std::span<const Eigen::Vector3f> p_L,
                        std::span<const Eigen::Vector3f> q_L, int reach, const TakeLeaves& take);

}  // namespace accessvdb::internal
