// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/tools/tool_heading.h"

#include <cmath>

#include "tool/expanded_orientations.h"

namespace accessvdb::internal {
namespace {

ToolHeading headingOf(const ToolOrientation& orientation) {
  ToolHeading heading;
  heading.yaw_rad = static_cast<float>(orientation.yaw_rad);
  if (orientation.R_WT(2, 0) == 0) {
    // A level direction is that of its yaw, as files have recorded it from the start: at quarter turns it is not quite
    // on the axis (6e-17), where scoring is.
    heading.direction_W = {static_cast<float>(std::cos(orientation.yaw_rad)),
                           static_cast<float>(std::sin(orientation.yaw_rad)), 0.0f};
  } else {
    heading.direction_W = orientation.R_WT.col(0).cast<float>();
  }
  Eigen::Quaterniond orientation_WT(orientation.R_WT);
  orientation_WT.normalize();
  if (orientation_WT.w() < 0) orientation_WT.coeffs() = -orientation_WT.coeffs();
  heading.orientation_WT = orientation_WT.cast<float>();
  return heading;
}

}  // namespace

std::vector<ToolHeading> toolHeadings(const ApproachParams& resolved, const ToolRolls& rolls) {
  std::vector<ToolHeading> headings;
  for (const ToolOrientation& orientation : ExpandedOrientations::of(resolved).all) {
    for (int roll = 0; roll < rolls.count; ++roll) headings.push_back(headingOf(rolledBy(orientation, rolls, roll)));
  }
  return headings;
}

}  // namespace accessvdb::internal
