// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Small scenes for the tests of the paper's update policy: upright plates, scanned from a chosen place.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "accessvdb/accessibility_field.h"

namespace accessvdb::test {

using Eigen::Vector3d;
inline constexpr double kVoxel_m = 0.02;   // tau = 0.08
inline constexpr int kEveryVoxel = 20000;  // a sample so large that it finds every written voxel of these scenes

/// Returns on an upright rectangle, one per voxel, in its middle. @param along  unit, horizontal, in the plane
inline std::vector<Vector3d> plate(const Vector3d& centre, const Vector3d& along, double half_width, double half_height,
                                   double step = kVoxel_m) {
  std::vector<Vector3d> points;
  const int across = static_cast<int>(std::lround(half_width / step));
  const int up = static_cast<int>(std::lround(half_height / step));
  for (int i = -across; i <= across; ++i) {
    for (int j = -up; j <= up; ++j) points.push_back(centre + i * step * along + Vector3d(0, 0, j * step));
  }
  return points;
}
/// Facing +x.
inline std::vector<Vector3d> plateAt(double x, double half = 0.1) { return plate({x, 0, 0}, {0, 1, 0}, half, half); }

/// The paper's parameters without any trigger, so that a test enables only the one under test.
inline FieldParams quietParams() {
  FieldParams p = FieldParams::paper(kVoxel_m);
  p.scoring.collision_distance_m = 0.5 * kVoxel_m;
  p.update.changed_voxel_sample = 0;
  p.update.requeue_motion_m = 1000;
  return p;
}

class Stream {
 public:
  explicit Stream(const FieldParams& params) : field_(ToolGeometry::builtin("builtin:pencil"), params) {}

  void scan(const std::vector<Vector3d>& points_W, const Vector3d& sensor_W) {
    field_.integrateRays(points_W, std::vector<Vector3d>{sensor_W});
  }
  UpdateStats scanAndUpdate(const std::vector<Vector3d>& points_W, const Vector3d& sensor_W) {
    scan(points_W, sensor_W);
    return field_.update();
  }
  [[nodiscard]] SurfacePoint at(const Vector3d& p_W) const {
    const auto point = field_.pointAt(p_W);
    EXPECT_TRUE(point.has_value()) << p_W.transpose();
    return point.value_or(SurfacePoint{});
  }
  [[nodiscard]] PointLabel labelFromScratch(const Vector3d& p_W) const {
    return field_.evaluateFromScratch().points.at(at(p_W).id).label;
  }
  AccessibilityField& field() { return field_; }

 private:
  AccessibilityField field_;
};

inline const Vector3d kMiddle(0, 0, 0);
inline const Vector3d kFront(1, 0, 0);

}  // namespace accessvdb::test
