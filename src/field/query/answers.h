// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a field answers about its points, for one tool or for the best one at each point.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/surface_points.h"
#include "field/field_stages.h"
#include "field/query/scored_points.h"

namespace accessvdb::internal {

/// Of the point in the voxel that contains p_W; kNone if there is none.
[[nodiscard]] std::uint32_t idAt(const FieldStages& field, const Eigen::Vector3d& p_W);

/// @throws InvalidArgument "point.id"  if one is no point, or comes twice
void requireIds(const FieldStages& field, std::span<const std::uint32_t> ids);

/// The points of one tool. @throws InvalidArgument "tool.index"
[[nodiscard]] ScoredField scoredFor(const FieldStages& field, std::size_t tool);
/// All points, with the state of the best tool at each.
[[nodiscard]] std::unique_ptr<const SurfacePoints> scoredPoints(const FieldStages& field);
/// Some of them, by ids that ascend, of the core for a tile.
[[nodiscard]] std::unique_ptr<const SurfacePoints> scoredPoints(const FieldStages& field,
                                                                std::span<const std::uint32_t> ids);
[[nodiscard]] SurfacePoint scoredPoint(const FieldStages& field, std::uint32_t id);

/// All points, scored anew. @param tests  if not null, how many (point, direction) tests that took
[[nodiscard]] FieldSnapshot evaluatedFromScratch(const FieldStages& field, std::uint64_t* tests);
/// @param ids  each once  @throws InvalidArgument "tool.index"
[[nodiscard]] std::vector<AccessMap> accessMapsOf(const FieldStages& field, std::span<const std::uint32_t> ids,
                                                  std::size_t tool);
/// As AccessibilityField::freeArcs_deg().
[[nodiscard]] std::vector<float> freeArcsOf(const FieldStages& field, std::span<const std::uint32_t> ids,
                                            std::size_t tool);

/// What poses are tried against. @throws ResourceLimit "field.broken"
[[nodiscard]] FitInputs fitInputs(FieldStages& field);

/// What views show. @throws ResourceLimit "field.broken"
[[nodiscard]] ViewInputs viewedParts(FieldStages& field);

}  // namespace accessvdb::internal
