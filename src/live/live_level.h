// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Turns a stream whose odometry is tilted level: by angles, or by what its IMU felt in the first second with poses, at
/// rest, as for recordings.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>

#include "accessvdb/live_session.h"
#include "io/poses/levelling.h"

namespace accessvdb::internal {

class LiveLevel {
 public:
  explicit LiveLevel(const std::optional<io::Level>& wanted);

  void add(const LiveImu& imu);
  /// As it was found before: nothing is measured.
  void set(const Eigen::Matrix3d& R_L_W);
  /// Whether nothing is turned, or it is known by how much.
  [[nodiscard]] bool isKnown() const { return !waits_; }
  /// From the frame of the poses to the level one; nothing where nothing is turned.
  [[nodiscard]] const std::optional<Eigen::Matrix3d>& R_L_W() const { return R_L_W_; }

  /// Of the first one.
  [[nodiscard]] const std::string& frame() const { return frame_; }
  /// Pose of the IMU at a time.
  using PoseOfImu = std::function<std::optional<Eigen::Isometry3d>(std::int64_t)>;
  /// When what was measured first that has a pose was measured.
  [[nodiscard]] std::optional<std::int64_t> firstPosed_ns(const PoseOfImu& T_W_I) const;
  /// Whether measure() would have an answer, or an error: the first second is over.
  /// @param past  whether poses have got past a time
  [[nodiscard]] bool isDue(const PoseOfImu& T_W_I, const std::function<bool(std::int64_t)>& past) const;
  /// @throws UnusableInput "level.no_imu", "level.moving"
  void measure(const PoseOfImu& T_W_I);

 private:
  bool waits_ = false;
  std::optional<Eigen::Matrix3d> R_L_W_;
  std::string frame_;
  std::deque<io::ImuSample> samples_;  ///< the latest io::kMostImuSamples
};

}  // namespace accessvdb::internal
