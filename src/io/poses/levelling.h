// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Turns a tilted frame of odometry so that z points up.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace accessvdb::io {

/// What an accelerometer at rest feels, which points up, and how fast it turns.
struct ImuSample {
  std::int64_t stamp_ns = 0;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();  ///< any unit
  Eigen::Vector3d turn_rad_s = Eigen::Vector3d::Zero();
};

/// Samples that are kept of a topic: the first minute at 200 Hz.
inline constexpr std::size_t kMostImuSamples = 12'000;

/// Of a frame turned by roll and pitch, yaw 0: what takes its coordinates into a level one.
[[nodiscard]] Eigen::Matrix3d levellingOf(double roll_rad, double pitch_rad);

/// The smallest turn that takes the mean force up.
/// @param force_W  of samples at rest, each turned into the world by its own pose
/// @throws UnusableInput "level.no_imu" (too few), "level.moving" (they differ by more than a platform at rest)
[[nodiscard]] Eigen::Matrix3d levellingOf(const std::vector<Eigen::Vector3d>& force_W, const std::string& subject);

/// The direction of the mean force, if there is enough of it and the platform is at rest.
[[nodiscard]] std::optional<Eigen::Vector3d> upByForce(const std::vector<Eigen::Vector3d>& force_W);

/// "25.1 degrees off z (roll 25.00, pitch -2.00 would level it)"
[[nodiscard]] std::string tiltInWords(const Eigen::Vector3d& up_W);

/// Roll and pitch of a levelling, degrees, for messages.
[[nodiscard]] std::string levelInWords(const Eigen::Matrix3d& R_L_W);

}  // namespace accessvdb::io
