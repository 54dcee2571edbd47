// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What point state reads from the map: observations and distances at points.
#pragma once

#include <optional>

#include "field/window_reach.h"
#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// @param map, points  must outlive the reads  @param core  points elsewhere have no weight, so they are never scored
MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight,
                      const std::optional<VoxelColumnBox>& core = std::nullopt);

}  // namespace accessvdb::internal
