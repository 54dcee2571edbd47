// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/trajectory.h"

#include <cmath>
#include <string>

#include "accessvdb/error.h"
#include "io/poses/pose_files.h"

namespace accessvdb::sim {
namespace {

constexpr int kMostFrames = 1'000'000;

void requireFrames(int frames) {
  if (frames >= 1 && frames <= kMostFrames) return;
  throw UnusableInput("sim.frames", "--frames",
                      frames < 1 ? "there are no frames to simulate" : "more than a million frames",
                      "Use --frames N with N from 1 to 1000000");
}

/// x ahead, y left, z up as far as possible; `ahead` is pitched down by pitch_rad.
Eigen::Matrix3d orientation(const Eigen::Vector3d& ahead_W, double pitch_rad) {
  Eigen::Vector3d left_W = Eigen::Vector3d::UnitZ().cross(ahead_W);
  // Straight up or down, left is undefined; any will do.
  left_W = left_W.norm() > 1e-9 ? left_W.normalized() : Eigen::Vector3d::UnitY();
  const Eigen::Vector3d up_W = ahead_W.cross(left_W);
  Eigen::Matrix3d R;
  R.col(0) = std::cos(pitch_rad) * ahead_W - std::sin(pitch_rad) * up_W;
  R.col(1) = left_W;
  R.col(2) = std::sin(pitch_rad) * ahead_W + std::cos(pitch_rad) * up_W;
  return R;
}

/// Share of the way from begin to end after so many sweeps: forwards in the first, back in the second, and so on.
double toAndFro(double sweeps) {
  const double phase = std::fmod(sweeps, 2.0);
  return phase <= 1 ? phase : 2 - phase;
}

}  // namespace

Trajectory helix(const Helix& shape, int frames) {
  requireFrames(frames);
  const Eigen::Vector<double, 8> numbers(shape.centre_W.x(), shape.centre_W.y(), shape.centre_W.z(),
                                         shape.height_begin_m, shape.height_end_m, shape.azimuth_begin_rad,
                                         shape.azimuth_end_rad, shape.object_elevation_rad);
  if (!numbers.allFinite()) throw InvalidArgument("sim.trajectory", "helix", "has a number that is not finite");
  if (!(shape.radius_m > 0) || !std::isfinite(shape.radius_m)) {
    throw InvalidArgument("sim.trajectory", "--radius", "is not a positive length", "Use metres");
  }
  if (shape.sweeps < 1) throw InvalidArgument("sim.trajectory", "helix", "has no sweep", "Use at least one");
  Trajectory path(static_cast<std::size_t>(frames));
  for (int i = 0; i < frames; ++i) {
    const double share = frames == 1 ? 0.5 : static_cast<double>(i) / (frames - 1);
    const double azimuth = std::lerp(shape.azimuth_begin_rad, shape.azimuth_end_rad, toAndFro(share * shape.sweeps));
    const double height_m = std::lerp(shape.height_begin_m, shape.height_end_m, share);
    const Eigen::Vector3d from_centre(shape.radius_m * std::cos(azimuth), shape.radius_m * std::sin(azimuth), height_m);
    Eigen::Isometry3d& T_W_S = path[static_cast<std::size_t>(i)];
    T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation() = shape.centre_W + from_centre;
    T_W_S.linear() = orientation(-from_centre.normalized(), shape.object_elevation_rad);
  }
  return path;
}

Trajectory orbit(const Helix& shape, int frames) {
  requireFrames(frames);
  Helix turn = shape;
  turn.height_end_m = shape.height_begin_m;
  turn.sweeps = 1;
  turn.azimuth_end_rad = shape.azimuth_begin_rad + 2 * std::numbers::pi * (1.0 - 1.0 / frames);
  if (frames == 1) turn.azimuth_end_rad = turn.azimuth_begin_rad;
  return helix(turn, frames);
}

Trajectory walk(const Eigen::Vector3d& begin_W, const Eigen::Vector3d& end_W, double pitch_rad, int frames) {
  requireFrames(frames);
  const Eigen::Vector3d way = end_W - begin_W;
  if (!way.allFinite() || !std::isfinite(pitch_rad) || !(way.norm() > 0)) {
    throw InvalidArgument("sim.trajectory", "walk", "has no length, or a number that is not finite",
                          "Use two different ends");
  }
  Trajectory path(static_cast<std::size_t>(frames));
  for (int i = 0; i < frames; ++i) {
    const double share = frames == 1 ? 0.5 : static_cast<double>(i) / (frames - 1);
    Eigen::Isometry3d& T_W_S = path[static_cast<std::size_t>(i)];
    T_W_S = Eigen::Isometry3d::Identity();
    T_W_S.translation() = begin_W + share * way;
    T_W_S.linear() = orientation(way.normalized(), pitch_rad);
  }
  return path;
}

Trajectory readTrajectory(const std::filesystem::path& tum) {
  const io::PoseFile file = io::readPoseFile(tum, io::PoseFormat::Tum, {}, false);
  Trajectory path;
  path.reserve(file.poses.size());
  for (const io::PoseEntry& entry : file.poses) path.push_back(entry.T_W_S);
  return path;
}

}  // namespace accessvdb::sim
