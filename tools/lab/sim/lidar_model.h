// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a sensor does: where its rays go, and how it reports their ranges.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <string>

namespace accessvdb::sim {

struct LidarModel {
  enum class Pattern {
    Mid360,   ///< 360 x [-7, 52] degrees, Halton(2,3) continuing from frame to frame
    Spinning  ///< 64 rings of 1024, +-22.5 degrees, the same rays in every frame
  };
  Pattern pattern = Pattern::Mid360;
  int rays_per_frame = 20000;  ///< Spinning: 65536
  double frame_period_s = 0.1;
  double range_noise_m = 0;  ///< sigma of the Gaussian along the ray
  double dropout = 0;        ///< share of returns lost, 0 .. 1; they read (0,0,0)
  double min_range_m = 0.05;
  double max_range_m = std::numeric_limits<double>::infinity();
  /// The sensor moves while it measures a frame, evenly from its pose to the next one of the trajectory.
  bool moves = false;

  /// "mid360" or "spinning". @throws InvalidArgument
  static LidarModel named(const std::string& name);
  /// The middle between its lowest and highest ray; trajectories keep the object there.
  [[nodiscard]] double middleElevation_rad() const;
  /// @throws InvalidArgument naming the field
  void validate() const;
};

/// When a ray is measured, since its frame began: one after the other over the whole frame.
[[nodiscard]] double rayTime_s(const LidarModel& model, int ray);

/// Unit direction of a ray in the sensor frame. @param frame  index over the whole run
[[nodiscard]] Eigen::Vector3f rayDirection_S(const LidarModel& model, std::uint64_t frame, int ray);

}  // namespace accessvdb::sim
