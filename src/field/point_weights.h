// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What point state reads from the map: observations and distances at points.
#pragma once

#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// @param map, points  must outlive the reads
MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight);

}  // namespace accessvdb::internal
