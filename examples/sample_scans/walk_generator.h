// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A walk past trees with a Mid-360-like scanner: scans and poses of a known scene, the same for the same options.
///
/// World: metres, z up, ground at z = 0. Sensor: x forward, z up; the mount tilts it forward so that it sees the
/// ground.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "sample_scans/analytic_scene.h"

namespace accessvdb::samples {

struct WalkOptions {
  int frames = 40;
  int rays_per_frame = 20000;
  double range_noise_m = 0.0;  ///< sigma of the Gaussian along the ray
  std::uint64_t seed = 1;      ///< for the scene and the noise
  double length_m = 0.0;       ///< of the walk along x; 0 = rule: 0.1 m per frame
  double max_range_m = 30.0;   ///< returns beyond become (0,0,0)
  double frame_period_s = 0.1;
  double mount_pitch_rad = 0.3;  ///< nose down
  double height_m = 1.3;         ///< of the sensor
  int trees = -1;                ///< -1 = rule: one per 7 square metres
  bool flat_ground = false;
  Eigen::Vector3d offset_W = {0, 0, 0};  ///< added to every pose: moves the scene elsewhere in the world
};

struct WalkFrame {
  std::vector<Eigen::Vector3f> points_S;  ///< [rays_per_frame] metres; exactly (0,0,0) = no return
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  double stamp_s = 0;
};

/// Frames can be generated in any order and from several threads.
class WalkGenerator {
 public:
  /// @throws InvalidArgument naming the option
  explicit WalkGenerator(const WalkOptions& options);

  [[nodiscard]] int frames() const { return options_.frames; }
  [[nodiscard]] WalkFrame frame(int index) const;
  [[nodiscard]] Eigen::Isometry3d pose(int index) const;  ///< T_W_S
  /// Unit direction of a ray in the sensor frame; the pattern continues from frame to frame without repeating.
  [[nodiscard]] Eigen::Vector3d rayDirection_S(int frame_index, int ray) const;
  [[nodiscard]] const WalkOptions& options() const { return options_; }
  [[nodiscard]] const AnalyticScene& scene() const { return scene_; }  ///< before offset_W

 private:
  WalkOptions options_;
  AnalyticScene scene_;
};

}  // namespace accessvdb::samples
