// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds whose points have times, made byte by byte from the specifications.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "unit/io/input_fixture.h"

namespace accessvdb::io::test {

struct TimedPoint {
  double stamp_s = 0;
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();
};

/// LAS 1.2 of point format 1, in steps of 1/1024 m, which doubles and decimal text with 10 digits hold exactly.
inline std::string timedLas(const std::vector<TimedPoint>& points) {
  constexpr double kScale = 1.0 / 1024;
  std::string file("LASF", 4);
  file.resize(24, '\0');
  file += "\1\2";
  file.resize(94, '\0');
  put(file, std::uint16_t{227});
  put(file, std::uint32_t{227});
  put(file, std::uint32_t{0});
  file += '\1';
  put(file, std::uint16_t{28});
  put(file, static_cast<std::uint32_t>(points.size()));
  file.resize(131, '\0');
  for (int axis = 0; axis < 3; ++axis) put(file, kScale);
  file.resize(179, '\0');
  for (int axis = 0; axis < 3; ++axis) {
    put(file, 1e9);
    put(file, -1e9);
  }
  for (const TimedPoint& point : points) {
    for (int axis = 0; axis < 3; ++axis) put(file, static_cast<std::int32_t>(point.p_W[axis] / kScale));
    file.append(8, '\0');
    put(file, point.stamp_s);
  }
  return file;
}

/// Binary PLY with doubles x y z and `time_name`.
inline std::string timedPly(const std::vector<TimedPoint>& points, const std::string& time_name = "time",
                            const std::string& time_type = "double") {
  std::string file = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(points.size()) +
                     "\nproperty double x\nproperty double y\nproperty double z\nproperty " + time_type + " " +
                     time_name + "\nend_header\n";
  for (const TimedPoint& point : points) {
    for (int axis = 0; axis < 3; ++axis) put(file, point.p_W[axis]);
    if (time_type == "float") {
      put(file, static_cast<float>(point.stamp_s));
    } else {
      put(file, point.stamp_s);
    }
  }
  return file;
}

}  // namespace accessvdb::io::test
