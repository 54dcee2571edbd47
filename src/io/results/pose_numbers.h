// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses as files and the page have them.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <nlohmann/json.hpp>

namespace accessvdb::internal {

/// Position, then the orientation with w >= 0 first.
inline std::array<double, 7> poseNumbers(const Eigen::Isometry3d& T) {
  Eigen::Quaterniond q(T.linear());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d& p = T.translation();
  std::array<double, 7> numbers = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  for (double& number : numbers) number += 0.0;  // no -0
  return numbers;
}

inline nlohmann::ordered_json poseJson(const Eigen::Isometry3d& T) {
  const std::array<double, 7> n = poseNumbers(T);
  return {{"position", {n[0], n[1], n[2]}}, {"orientation_wxyz", {n[3], n[4], n[5], n[6]}}};
}

}  // namespace accessvdb::internal
