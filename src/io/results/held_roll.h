// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The roll of a tool, from how it is held.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace accessvdb::internal {

/// About the tool's body, 0 up to below 2 pi; 0: its top is as far up as it can be. Straight up and down, yaw is 0.
[[nodiscard]] inline double rollOf(const Eigen::Quaternionf& orientation_WT) {
  const Eigen::Matrix3d R_WT = orientation_WT.cast<double>().normalized().toRotationMatrix();
  constexpr double kUpright = 1e-5;  // a quaternion in float32 is not better
  const bool upright = std::hypot(R_WT(0, 0), R_WT(1, 0)) < kUpright;
  const double roll_rad =
      upright ? std::atan2(R_WT(2, 0) > 0 ? -R_WT(0, 1) : R_WT(0, 1), R_WT(1, 1)) : std::atan2(R_WT(2, 1), R_WT(2, 2));
  constexpr double kTurn = 2 * std::numbers::pi, kRounding = 1e-6;
  if (roll_rad >= 0) return roll_rad;
  return roll_rad > -kRounding ? 0 : roll_rad + kTurn;
}

}  // namespace accessvdb::internal
