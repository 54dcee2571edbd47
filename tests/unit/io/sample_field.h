// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A small field with every label and reason, far from the world's origin.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

#include "accessvdb/types.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {

inline constexpr double kVoxel_m = 0.02;
inline const Eigen::Vector3d kOrigin_W = {500000.0, 5600000.02, 300.0};
inline constexpr int kDirections = 180;

/// 30 x 20 points on a bumpy sheet, one per voxel; positions off the voxel centres, indices on both sides of zero.
inline FieldSnapshot sampleField() {
  FieldSnapshot field;
  field.origin_W = kOrigin_W;
  field.voxel_size_m = kVoxel_m;
  for (int i = -15; i < 15; ++i) {
    for (int j = -10; j < 10; ++j) {
      SurfacePoint point;
      point.id = static_cast<std::uint32_t>(field.points.size());
      const int n = static_cast<int>(point.id);
      const double off = 0.4 * kVoxel_m * std::sin(0.7 * n);
      point.position_W =
          kOrigin_W + Eigen::Vector3d(i * kVoxel_m + off, j * kVoxel_m - off, ((n * 7) % 5 - 2) * kVoxel_m + off);
      point.normal_W = Eigen::Vector3f(0.1f * static_cast<float>(i), 0.2f, 1.0f).normalized();
      point.label = static_cast<PointLabel>(n % 3);
      point.reason = point.label == PointLabel::Accessible ? PointReason::None : static_cast<PointReason>(1 + n % 6);
      point.weight = static_cast<float>(n % 40);
      point.confidence = point.weight / (point.weight + 5.0f);
      point.stability = 1.0f / static_cast<float>(1 + n % 4);
      if (point.label != PointLabel::Unscored) {
        point.direction = static_cast<std::uint16_t>(n % kDirections);
        point.yaw_rad = static_cast<float>(2 * M_PI * point.direction / kDirections);
        point.direction_W = {std::cos(point.yaw_rad), std::sin(point.yaw_rad), 0.0f};
        point.score = static_cast<std::uint16_t>(n);
      }
      if (point.label != PointLabel::Unscored) point.access_probability = static_cast<float>(n % 8) / 8;
      point.confident = point.label == PointLabel::Accessible && point.confidence * point.stability > 0.7f;
      field.points.push_back(point);
    }
  }
  return field;
}

}  // namespace accessvdb::test
