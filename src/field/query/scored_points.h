// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points as users see them, from the arrays of their state.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/surface_points.h"
#include "field/tools/window_margins.h"
#include "tool/tool_rolls.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// Which state belongs to the points.
enum class PointStates {
  AsOfTheLastUpdate,  ///< read from the backend
  None                ///< all are unscored; no array of the backend is read
};

/// What the users' points are made from.
struct ScoredField {
  const PointScorer& scorer;
  kernels::Backend& backend;  ///< the one that holds the scorer's arrays
  Eigen::Vector3d origin_W;
  ToolRolls rolls;
  std::uint16_t collision_limit = 1;                  ///< [n_c] of the tool
  std::optional<VoxelColumnBox> core = std::nullopt;  ///< of a tile, whose other points are not the user's
  bool some_wait = false;                             ///< the last update left a backlog: no label is certain
  std::span<const std::uint8_t> withheld = {};        ///< by id, see LeftOutPoints; later points are not
  const PointAttributes* attributes = nullptr;        ///< of the points; null: none
};

/// All points, those of the core for a tile. Labels, scores and weights are copied, 24 bytes per point; positions
/// and attributes are read from the scorer's store, which must live as long and keep its points.
[[nodiscard]] std::unique_ptr<const SurfacePoints> scoredPoints(const ScoredField& field, PointStates states);

/// Some of them. @param ids  of the core for a tile, ascending
[[nodiscard]] std::unique_ptr<const SurfacePoints> scoredPoints(const ScoredField& field,
                                                                std::span<const std::uint32_t> ids);

/// A copy of all of them.
[[nodiscard]] FieldSnapshot snapshotOf(const SurfacePoints& points);

/// One of them.
[[nodiscard]] SurfacePoint scoredPoint(const ScoredField& field, std::uint32_t id);

}  // namespace accessvdb::internal
