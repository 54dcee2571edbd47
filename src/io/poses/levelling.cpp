// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/levelling.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "accessvdb/error.h"
#include "accessvdb/program/scan_agreement.h"

namespace accessvdb::io {
namespace {

/// A tenth of a second at 200 Hz; fewer would be noise.
constexpr std::size_t kLeastSamples = 20;
/// Spread of the force over its mean: hovering and engines stay below, walking does not.
constexpr double kRestSpread = 0.1;

}  // namespace

Eigen::Matrix3d levellingOf(double roll_rad, double pitch_rad) {
  return (Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(roll_rad, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

std::optional<Eigen::Vector3d> upByForce(const std::vector<Eigen::Vector3d>& force_W) {
  if (force_W.size() < kLeastSamples) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& force : force_W) mean += force;
  mean /= static_cast<double>(force_W.size());
  double square = 0;
  for (const Eigen::Vector3d& force : force_W) square += (force - mean).squaredNorm();
  const double spread = std::sqrt(square / static_cast<double>(force_W.size()));
  if (!(mean.norm() > 0) || !std::isfinite(mean.norm()) || !std::isfinite(spread) ||
      !(spread <= kRestSpread * mean.norm()))
    return std::nullopt;
  return mean.normalized();
}

Eigen::Matrix3d levellingOf(const std::vector<Eigen::Vector3d>& force_W, const std::string& subject) {
  if (force_W.size() < kLeastSamples)
    throw UnusableInput(
        "level.no_imu", subject,
        "has " + std::to_string(force_W.size()) + " measurements of an IMU with a pose at the start; " +
            std::to_string(kLeastSamples) + " are needed to find what is up",
        "Record sensor_msgs/Imu from before the start, or give ScanInputOptions::level ROLL,PITCH in degrees");
  const auto up_W = upByForce(force_W);
  if (!up_W)
    throw UnusableInput("level.moving", subject, "its IMU is not at rest at the start, so gravity cannot be told",
                        "Give ScanInputOptions::level ROLL,PITCH in degrees, or start at rest");
  return Eigen::Quaterniond::FromTwoVectors(*up_W, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

Level levelFor(const Eigen::Vector3d& up_W) {
  return {false, std::atan2(up_W.y(), up_W.z()), std::atan2(-up_W.x(), std::hypot(up_W.y(), up_W.z()))};
}

std::string tiltInWords(const Eigen::Vector3d& up_W) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const Level level = levelFor(up_W);
  char text[128];
  std::snprintf(text, sizeof text, "%.1f degrees off z (roll %.2f, pitch %.2f would level it)",
                kDegrees * std::acos(std::clamp(up_W.normalized().z(), -1.0, 1.0)), kDegrees * level.roll_rad,
                kDegrees * level.pitch_rad);
  return text;
}

std::string levelInWords(const Eigen::Matrix3d& R_L_W) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  char text[96];
  std::snprintf(text, sizeof text, "roll %.2f, pitch %.2f degrees", kDegrees * std::atan2(R_L_W(2, 1), R_L_W(2, 2)),
                kDegrees * -std::asin(R_L_W(2, 0)));
  return text;
}

}  // namespace accessvdb::io
