// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The sets of docs/orientations.md, written a second time for the ground truth: no function is shared with the method.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace accessvdb::eval {

/// Rz(yaw) Ry(-pitch) Rx(roll); degrees.
[[nodiscard]] Eigen::Matrix3d heldAt(double yaw_deg, double pitch_deg, double roll_deg);
/// World from tool, evenly spread from +x counter-clockwise.
[[nodiscard]] std::vector<Eigen::Matrix3d> yawOrientations(int num_directions);
/// "yaw", "pitch:MIN:MAX:STEP", "sphere:STEP" or "sphere:STEP+yaw", however many that are.
/// @throws InvalidArgument "truth.orientations" for any other text
[[nodiscard]] std::vector<Eigen::Matrix3d> truthOrientations(const std::string& text, int num_directions);
/// Each of them turned about the tool's body, in `rolls` even steps over 1 / fold of a turn.
[[nodiscard]] std::vector<Eigen::Matrix3d> rolled(const std::vector<Eigen::Matrix3d>& orientations, int rolls,
                                                  int fold);

}  // namespace accessvdb::eval
