// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Leaves out the returns from the platform itself.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
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

/// The same with what the points carry. @param attributes  rows, one for each point; or empty
template <typename Point>
[[nodiscard]] std::uint64_t leaveOutInside(const Eigen::AlignedBox3d& box_S, const Eigen::Isometry3d& T_S_P,
                                           std::vector<Point>& points, std::vector<std::int32_t>& attributes) {
  if (attributes.empty()) return leaveOutInside(box_S, T_S_P, points);
  const std::size_t before = points.size(), width = attributes.size() / before;
  std::size_t kept = 0;
  for (std::size_t n = 0; n < before; ++n) {
    if (!points[n].isZero(0) && box_S.contains(T_S_P * points[n].template cast<double>().eval())) continue;
    points[kept] = points[n];
    std::copy_n(attributes.begin() + static_cast<std::ptrdiff_t>(n * width), width,
                attributes.begin() + static_cast<std::ptrdiff_t>(kept++ * width));
  }
  points.resize(kept);
  attributes.resize(kept * width);
  return before - kept;
}

}  // namespace accessvdb::io
