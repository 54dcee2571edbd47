// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// From the rays that went into a field to the input of the oracle: surface points gathered by plain code, the map
/// copied voxel by voxel. Nothing here calls the library's scoring.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "support/brute_force_field.h"
#include "support/dense_map.h"
#include "tool/tool_kernel.h"

namespace accessvdb::test {

/// Rays of one scan, world frame, metres; one origin per ray.
struct RayScan {
  std::vector<Eigen::Vector3d> points_W, origins_W;
};

/// A point as the rules of the point store define it.
struct GatheredPoint {
  VoxelCoord voxel = {};
  Eigen::Vector3f first_L = {0, 0, 0};
  Eigen::Vector3f mean_L = {0, 0, 0};
  Eigen::Vector3d sensor_L = {0, 0, 0};
  std::vector<bool> seen;
};

/// Points in the order of ids. @param resolved  parameters of the field, @param origin_W  its local origin
[[nodiscard]] std::vector<GatheredPoint> gatherPoints(const std::vector<RayScan>& scans, const FieldParams& resolved,
                                                      const Eigen::Vector3d& origin_W);

/// Everything except the map. Normals are the snapshot's, if it has one. Each roll of a direction is a direction of the
/// oracle: d R + r, with R rolls.
[[nodiscard]] BruteForceInput oracleInput(const AccessibilityField& field, const std::vector<GatheredPoint>& points,
                                          const FieldSnapshot& snapshot);

/// The field's map, copied through TsdfVolume::at.
[[nodiscard]] DenseMap copyOfMap(const TsdfVolume& volume);

/// The library's own tables of the tool: how a mesh becomes voxels or samples is tested elsewhere.
[[nodiscard]] internal::ToolKernel toolKernel(const AccessibilityField& field);

}  // namespace accessvdb::test
