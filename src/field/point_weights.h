// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What point state reads from the map: observations and distances at points.
#pragma once

#include <optional>

#include "change/gone_points.h"
#include "field/tools/window_margins.h"
#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// @param map, points  must outlive the reads  @param core  points elsewhere have no weight, so they are never scored
MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight,
                      const std::optional<VoxelColumnBox>& core = std::nullopt);

/// The same, except that opened voxels leave the weights of points as they were. @param gone  must outlive the result
MapReads readsWithGone(const MapReads& map, const PointStore& points, const GonePoints& gone);

}  // namespace accessvdb::internal
