// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Converts state arrays to points as users see them.
#pragma once

#include "accessvdb/types.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// @param backend  the one that holds the scorer's arrays
FieldSnapshot makeSnapshot(const PointScorer& scorer, kernels::Backend& backend, const Eigen::Vector3d& origin_W);

/// The same points without reading those arrays: all are unscored.
FieldSnapshot makeUnscoredSnapshot(const PointScorer& scorer, const Eigen::Vector3d& origin_W);

/// One point of the snapshot.
SurfacePoint makePoint(const PointScorer& scorer, kernels::Backend& backend, const Eigen::Vector3d& origin_W,
                       std::uint32_t id);

}  // namespace accessvdb::internal
