// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the sensor was, as far as poses that have come say so.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/live_session.h"
#include "io/scans/scan_motion.h"
#include "live/live_frames.h"
#include "live/live_level.h"
#include "live/pose_buffer.h"

namespace accessvdb::internal {

/// The sensor's poses around those of a scan's returns.
struct SensorMotion {
  Eigen::Isometry3d T_W_B, T_W_S;  ///< at the scan's stamp; T_W_B as it was given, the sensor's in the level frame
  Eigen::Isometry3d T_W_registered = Eigen::Isometry3d::Identity();  ///< from the frame of the poses
  std::int64_t first_ms = 0;                                         ///< from the stamp on
  std::vector<std::optional<Eigen::Isometry3d>> T_W_S_at;            ///< at each millisecond

  [[nodiscard]] std::optional<Eigen::Isometry3d> at(std::int64_t ms) const {
    const auto n = static_cast<std::uint64_t>(ms - first_ms);
    return n < T_W_S_at.size() ? T_W_S_at[n] : std::nullopt;
  }
  /// At most so far does a point within that range lie from where it would be at the scan's stamp.
  [[nodiscard]] double spread_m(double range_m) const;
};

/// Not thread-safe. Frames are those of scans.
class LivePoses {
 public:
  explicit LivePoses(const LiveOptions& options)
      : T_B_S_(options.T_B_S),
        poses_(options.most_poses, options.max_gap_s),
        frames_(options.most_poses, options.max_gap_s),
        level_(options.level) {}

  void add(const LivePose& pose);
  void add(const LiveTransform& transform) {
    frames_.add(transform);
    level_is_due_.reset();
  }
  void add(const LiveImu& imu) {
    level_.add(imu);
    level_is_due_.reset();
  }
  /// Whether findLevel() has something to do.
  [[nodiscard]] bool levelIsDue() const;
  /// @throws UnusableInput "level.no_imu", "level.moving"
  void findLevel();
  [[nodiscard]] const LiveLevel& level() const { return level_; }
  void setLevelling(const Eigen::Matrix3d& R_L_W) {
    level_.set(R_L_W);
    level_is_due_.reset();
  }
  /// No more will come. A later add() takes it back.
  void end() { ended_ = true; }
  [[nodiscard]] bool isEnd() const { return ended_; }

  /// Whether points in that frame are where they were measured.
  [[nodiscard]] bool isRegistered(const std::string& frame) const {
    return !frame.empty() && world_frame_ && frame == *world_frame_;
  }
  /// @param ms  asks for poses at these, too, from the stamp on
  [[nodiscard]] std::optional<SensorMotion> motionAt(const std::string& frame, std::int64_t stamp_ns,
                                                     const std::optional<io::WholeMilliseconds>& ms = {}) const;
  /// Whether there is a pose, or will never be.
  [[nodiscard]] bool isSettled(const std::string& frame, std::int64_t stamp_ns) const;
  /// Whether there is none, and never will be.
  [[nodiscard]] bool isHopeless(const std::string& frame, std::int64_t stamp_ns) const {
    return isSettled(frame, stamp_ns) && !motionAt(frame, stamp_ns);
  }
  [[nodiscard]] bool isFarAhead(std::int64_t stamp_ns, std::int64_t far_ns) const {
    return poses_.isFarAhead(stamp_ns, far_ns);
  }
  /// A scan of that frame was taken, or dropped for want of a pose.
  void noteTaken(const std::string& frame, const SensorMotion& motion);
  void noteDropped(const std::string& frame);

  void tell(LiveStatus& status) const;

 private:
  /// By which transforms a frame is posed.
  struct Route {
    bool direct = false;  ///< by none: it is that of the sensor whose pose is known
    std::optional<LiveFrames::Chain> chain = {};
  };
  [[nodiscard]] Route routeTo(const std::string& frame) const;
  [[nodiscard]] std::optional<Eigen::Isometry3d> sensorAt(const Route& route, std::int64_t stamp_ns,
                                                          const Eigen::Isometry3d& T_W_B) const;

  /// And whether transforms connect it.
  [[nodiscard]] std::pair<LiveLevel::PoseOfImu, bool> poseOfImu() const;

  std::optional<Eigen::Isometry3d> T_B_S_;
  PoseBuffer poses_;
  LiveFrames frames_;
  LiveLevel level_;
  mutable std::optional<bool> level_is_due_;  ///< nothing that decides it has come since
  std::optional<std::string> world_frame_;
  std::string child_;
  std::string sensor_chain_, unconnected_, unconnected_imu_;
  double extrinsic_m_ = 0;
  std::uint64_t added_ = 0, other_frame_ = 0;
  bool taken_ = false, ended_ = false;
};

}  // namespace accessvdb::internal
