// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What point state reads from the map: observations and distances at points.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "change/gone_points.h"
#include "field/tools/window_margins.h"
#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

class LeadingMap;

/// @param map, points  must outlive the reads  @param core  points elsewhere have no weight, so they are never scored
MapReads makeMapReads(const PackedMap& map, const PointStore& points, bool neighbourhood_weight,
                      const std::optional<VoxelColumnBox>& core = std::nullopt);

/// MapReads::weights_at of a map. @param reach  of the voxels around each
void readWeightsOfMap(const PackedMap& map, int reach, std::span<const Index3> voxels,
                      std::span<std::uint16_t> weights);

/// Of so many points a device that leads is not asked if the host's map has all scans: reading that is sooner.
inline constexpr std::uint32_t kWeightsOnHost = 1 << 18;

/// The same as `map`, but of the device's map as long as it leads. @param lead, points  must outlive the result; *lead
/// may be null, and may change
MapReads readsOfLead(const MapReads& map, const PointStore& points, bool neighbourhood_weight,
                     const std::unique_ptr<LeadingMap>& lead);

/// The same, except that opened voxels leave the weights of points as they were. @param gone  must outlive the result
MapReads readsWithGone(const MapReads& map, const PointStore& points, const GonePoints& gone);

}  // namespace accessvdb::internal
