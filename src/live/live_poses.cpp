// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_poses.h"

#include <algorithm>

namespace accessvdb::internal {

double SensorMotion::spread_m(double range_m) const {
  double spread_m = 0;
  for (const auto& other : T_W_S_at) {
    if (!other) continue;
    const double moved_m = (other->translation() - T_W_S.translation()).norm();
    const double turned = (other->linear() - T_W_S.linear()).norm();  // no less than that of any unit vector
    spread_m = std::max(spread_m, moved_m + turned * range_m);
  }
  return spread_m;
}

void LivePoses::add(const LivePose& pose) {
  ++added_;
  ended_ = false;
  if (world_frame_ && pose.frame != *world_frame_) {
    ++other_frame_;
    return;
  }
  if (poses_.add(pose.stamp_ns, pose.p_W, pose.q_W_B) && !world_frame_) world_frame_ = pose.frame;
}

std::optional<SensorMotion> LivePoses::motionAt(std::int64_t stamp_ns,
                                                const std::optional<io::WholeMilliseconds>& ms) const {
  const auto sensorOn = [this](const Eigen::Isometry3d& T_W_B) { return T_B_S_ ? T_W_B * *T_B_S_ : T_W_B; };
  const auto T_W_B = poses_.at(stamp_ns);
  if (!T_W_B) return std::nullopt;
  SensorMotion motion = {*T_W_B, sensorOn(*T_W_B), 0, {}};
  if (!ms) return motion;
  motion.first_ms = ms->first;
  for (std::int64_t at = ms->first; at <= ms->last; ++at) {
    const auto T_W_B_then = poses_.at(stamp_ns + at * 1'000'000);
    motion.T_W_S_at.push_back(T_W_B_then ? std::optional(sensorOn(*T_W_B_then)) : std::nullopt);
  }
  return motion;
}

void LivePoses::tell(LiveStatus& status) const {
  status.poses = added_;
  status.poses_invalid = poses_.counts().invalid;
  status.poses_repeated = poses_.counts().repeated;
  status.poses_backwards = poses_.counts().backwards;
  status.poses_other_frame = other_frame_;
  status.world_frame = world_frame_.value_or("");
}

}  // namespace accessvdb::internal
