// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scenes in which a tool moves: scanned without noise, with known free space.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "eval/table_context.h"
#include "sim/signed_distance.h"

namespace accessvdb::eval {

struct ActionScene {
  std::string name;
  std::shared_ptr<const sim::SignedDistance> distance;
  AccessibilityField field;               ///< after its update; of the pine with margins of one and two voxels
  Eigen::AlignedBox3d box_W;              ///< what the sensor flew through
  Eigen::Vector3d start_W;                ///< its first position
  double spacing_m = 0, stand_off_m = 0;  ///< as ApproachOptions
};

inline constexpr const char* kActionScenes[] = {"torus", "table_underside", "pine"};

/// Of scans without noise, all rays cleared to the sensor.
[[nodiscard]] FieldParams clearedParams(const TableContext& context, double voxel_size_m);

/// The first two at 5 mm with the pencil, the pine at 50 mm with the pruner. @param name  of kActionScenes
[[nodiscard]] ActionScene makeActionScene(TableContext& context, const std::string& name);

}  // namespace accessvdb::eval
