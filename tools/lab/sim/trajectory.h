// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the sensor is, frame by frame: T_W_S, sensor to world.
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <numbers>
#include <vector>

namespace accessvdb::sim {

/// A helix around centre_W; the sensor is pitched so that the centre is at a given elevation in its frame, straight
/// ahead (azimuth 0). One turn without height is an orbit; part of a turn is an arc.
struct Helix {
  Eigen::Vector3d centre_W = {0, 0, 0};
  double radius_m = 0.5;
  double height_begin_m = 0, height_end_m = 0;  ///< height of the sensor above the centre
  double azimuth_begin_rad = 0, azimuth_end_rad = 0;
  int sweeps = 1;  ///< times the azimuth runs from begin to end, or back, while the height runs once; >= 1
  double object_elevation_rad = 22.5 * std::numbers::pi / 180;  ///< the middle of the Mid-360's view
};

using Trajectory = std::vector<Eigen::Isometry3d>;

/// Evenly spaced in azimuth and height, both ends included; a single frame is in the middle.
/// @throws InvalidArgument (radius, non-finite), UnusableInput (no frames)
[[nodiscard]] Trajectory helix(const Helix& shape, int frames);
/// One level turn at shape.height_begin_m from shape.azimuth_begin_rad; the last frame is one step before the first.
[[nodiscard]] Trajectory orbit(const Helix& shape, int frames);
/// A straight walk, both ends included; the sensor looks along it, pitched down by pitch_rad.
/// @throws InvalidArgument (no length), UnusableInput (no frames)
[[nodiscard]] Trajectory walk(const Eigen::Vector3d& begin_W, const Eigen::Vector3d& end_W, double pitch_rad,
                              int frames);
/// TUM poses. @throws InputError, UnusableInput
[[nodiscard]] Trajectory readTrajectory(const std::filesystem::path& tum);

}  // namespace accessvdb::sim
