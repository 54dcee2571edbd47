// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/sensor_options.h"

#include <cmath>
#include <numbers>

#include "accessvdb/error.h"
#include "options/options.h"

namespace accessvdb::tools {
namespace {

Eigen::Isometry3d parsePose(const std::string& flag, const std::string& text) {
  constexpr double kRadians = std::numbers::pi / 180;
  const std::vector<double> v = parseNumbers(flag, text, {3, 6, 7}, "X,Y,Z,ROLL,PITCH,YAW or X,Y,Z,QX,QY,QZ,QW");
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(v[0], v[1], v[2]);
  if (v.size() == 6) {
    const auto turn = [&](std::size_t i, const Eigen::Vector3d& axis) {
      return Eigen::AngleAxisd(v[i] * kRadians, axis);
    };
    pose.linear() =
        (turn(5, Eigen::Vector3d::UnitZ()) * turn(4, Eigen::Vector3d::UnitY()) * turn(3, Eigen::Vector3d::UnitX()))
            .toRotationMatrix();
  } else if (v.size() == 7) {
    const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
    if (!(std::abs(q.norm() - 1) <= 1e-2))
      throw InvalidArgument("usage.extrinsic", flag, "has a quaternion of length " + numberText(q.norm()) + ", not 1",
                            "Use QX,QY,QZ,QW, w last");
    pose.linear() = q.normalized().toRotationMatrix();
  }
  return pose;
}

}  // namespace

void addSensorOptions(FlagParser& flags, SensorOptions& options) {
  flags.option(
      "--extrinsic", &options.extrinsic,
      "pose of the sensor in the frame whose poses are given (an IMU, a body): X,Y,Z,ROLL,PITCH,YAW in metres and "
      "degrees, turned about z by yaw, then y, then x; or X,Y,Z,QX,QY,QZ,QW");
  flags.option("--exclude-box", &options.exclude_box,
               "leave out returns inside X0,Y0,Z0,X1,Y1,Z1 in the sensor's frame, metres: the platform itself");
}

void addMotionOptions(FlagParser& flags, SensorOptions& options) {
  flags.option("--deskew", &options.deskew,
               "remove the sensor's motion within a scan, by the times of its points: auto (where there are times and "
               "poses), on (or refuse) or off");
  flags.option("--level", &options.level,
               "turn the map level where the odometry's frame is tilted: ROLL,PITCH of that frame in degrees, or imu "
               "(recordings and live: by what sensor_msgs/Imu felt at rest at the start)");
}

void applySensorOptions(const SensorOptions& options, io::ScanInputOptions& input) {
  if (!options.extrinsic.empty()) input.T_B_S = parsePose("--extrinsic", options.extrinsic);
  if (options.deskew != "auto" && options.deskew != "on" && options.deskew != "off")
    throw InvalidArgument("usage.word", "--deskew", "\"" + options.deskew + "\" is not known",
                          "Use one of auto, on, off");
  input.deskew = options.deskew == "auto" ? io::Deskew::Auto
                 : options.deskew == "on" ? io::Deskew::On
                                          : io::Deskew::Off;
  if (options.level == "imu") {
    input.level = io::Level{.from_imu = true};
  } else if (!options.level.empty()) {
    constexpr double kRadians = std::numbers::pi / 180;
    const std::vector<double> angles = parseNumbers("--level", options.level, {2}, "ROLL,PITCH in degrees, or imu");
    input.level = io::Level{false, angles[0] * kRadians, angles[1] * kRadians};
  }
  if (options.exclude_box.empty()) return;
  const std::vector<double> v = parseNumbers("--exclude-box", options.exclude_box, {6}, "X0,Y0,Z0,X1,Y1,Z1");
  input.exclude_box_S = Eigen::AlignedBox3d(Eigen::Vector3d(v[0], v[1], v[2]), Eigen::Vector3d(v[3], v[4], v[5]));
}

std::vector<std::pair<std::string, std::string>> givenSensorOptions(const SensorOptions& options) {
  std::vector<std::pair<std::string, std::string>> given;
  if (!options.extrinsic.empty()) given.emplace_back("extrinsic", options.extrinsic);
  if (!options.exclude_box.empty()) given.emplace_back("exclude_box", options.exclude_box);
  if (options.deskew != "auto") given.emplace_back("deskew", options.deskew);
  if (!options.level.empty()) given.emplace_back("level", options.level);
  return given;
}

}  // namespace accessvdb::tools
