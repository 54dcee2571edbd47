// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves out the returns from the platform itself.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

namespace accessvdb::io {

/// @param T_S_P  from the frame of the points to the sensor's
/// @return how many are left out. What is at exactly (0,0,0), "no return", stays: it is counted as such.
template <typename Point>
[[nodiscard]] std::uint64_t leaveOutInside(const Eigen::AlignedBox3d& box_S, const Eigen::Isometry3d& T_S_P,
                                           std::vector<Point>& points) {
  return std::erase_if(
      points, [&](const Point& p) { return !p.isZero(0) && box_S.contains(T_S_P * p.template cast<double>().eval()); });
}

}  // namespace accessvdb::io
