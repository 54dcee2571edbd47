// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How a tool is held in each direction, as users see it.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "accessvdb/params.h"
#include "tool/tool_rolls.h"

namespace accessvdb::internal {

struct ToolHeading {
  float yaw_rad = 0;
  Eigen::Vector3f direction_W = {0, 0, 0};  ///< unit, outwards along the tool's body
  Eigen::Quaternionf orientation_WT = Eigen::Quaternionf::Identity();
};

/// One per direction and roll: direction d with roll r is d rolls.count + r.
[[nodiscard]] std::vector<ToolHeading> toolHeadings(const ApproachParams& resolved, const ToolRolls& rolls = {});

}  // namespace accessvdb::internal
