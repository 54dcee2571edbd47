// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A piece of orchard along a path: trees with whorls of branches, a few crates, a wall, gently uneven ground.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "sample_scans/analytic_scene.h"

namespace accessvdb::samples {

struct ForestOptions {
  double path_length_m = 4.0;
  int trees = -1;  ///< -1 = rule: one per 7 square metres
  bool flat_ground = false;
  std::uint64_t seed = 1;
};

/// Ground track of the walk at x = s: a gentle S. The forest leaves it clear.
[[nodiscard]] Eigen::Vector2d pathPoint(double s_m);
/// Yaw of the track at x = s.
[[nodiscard]] double pathYaw(double s_m);

[[nodiscard]] AnalyticScene makeForest(const ForestOptions& options);

}  // namespace accessvdb::samples
