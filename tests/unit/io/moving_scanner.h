// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A scanner that flies and turns at constant speeds in front of a wall, in closed form: where each of its returns is.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace accessvdb::io::test {

struct MovingScanner {
  Eigen::Vector3d start_W = {1, 2, 0.5};
  Eigen::Vector3d speed_m_s = {0.5, 2, -0.3};
  double turn_rad_s = 1.5;  ///< about z
  double stamp_s = 100;     ///< of the first scan
  double period_s = 0.1;
  double wall_m = 8;  ///< the wall is at this x in the world

  [[nodiscard]] Eigen::Isometry3d at(double t_s) const {
    Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.linear() = Eigen::AngleAxisd(turn_rad_s * (t_s - stamp_s), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T_W_S.translation() = start_W + speed_m_s * (t_s - stamp_s);
    return T_W_S;
  }
  [[nodiscard]] double timeOf(std::size_t i, std::size_t count) const {
    return period_s * static_cast<double>(i) / static_cast<double>(count);
  }
  /// The i-th point on the wall, world frame.
  [[nodiscard]] Eigen::Vector3d pointOn(std::size_t i) const {
    return {wall_m, static_cast<double>(i % 37) / 8 - 2, static_cast<double>(i % 11) / 4 - 1};
  }
  /// What the scanner measures of it, at its own time.
  [[nodiscard]] Eigen::Vector3f measured(std::size_t scan, std::size_t i, std::size_t count) const {
    const double t_s = stamp_s + period_s * static_cast<double>(scan) + timeOf(i, count);
    return (at(t_s).inverse(Eigen::Isometry) * pointOn(i)).cast<float>();
  }
  /// TUM, every so many seconds.
  [[nodiscard]] std::string poses(double seconds, double every_s) const {
    std::string text;
    for (int i = 0; i * every_s <= seconds + 1e-9; ++i) {
      const Eigen::Isometry3d T_W_S = at(stamp_s + i * every_s);
      const Eigen::Quaterniond q(T_W_S.linear());
      const Eigen::Vector3d t = T_W_S.translation();
      char line[300];
      std::snprintf(line, sizeof line, "%.6f %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", stamp_s + i * every_s, t.x(),
                    t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
      text += line;
    }
    return text;
  }
};

}  // namespace accessvdb::io::test
