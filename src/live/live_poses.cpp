// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_poses.h"

#include <algorithm>

namespace accessvdb::internal {
namespace {

/// So long is waited for transforms, by the poses' times: fixed ones come once, at the start, and late.
constexpr std::int64_t kPatience_ns = 10'000'000'000;

}  // namespace

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
  level_is_due_.reset();
  const std::string frame = io::plainFrame(pose.frame), child = io::plainFrame(pose.child);
  if (world_frame_ && (frame != *world_frame_ || child != child_)) {
    ++other_frame_;
    return;
  }
  if (!poses_.add(pose.stamp_ns, pose.p_W, pose.q_W_B) || world_frame_) return;
  world_frame_ = frame;
  child_ = child;
  if (!child.empty()) frames_.setPosed(frame.empty() ? io::kWorldFrame : frame, child);
}

LivePoses::Route LivePoses::routeTo(const std::string& frame) const {
  // The extrinsic says where the sensor is on what is posed, whatever transforms say.
  if (T_B_S_ || frame.empty() || child_.empty() || frame == child_ || isRegistered(frame)) return {true};
  return {false, frames_.chain(world_frame_->empty() ? io::kWorldFrame : *world_frame_, frame)};
}

std::optional<Eigen::Isometry3d> LivePoses::sensorAt(const Route& route, std::int64_t stamp_ns,
                                                     const Eigen::Isometry3d& T_W_B) const {
  if (route.direct) return T_B_S_ ? T_W_B * *T_B_S_ : T_W_B;
  return route.chain ? frames_.at(*route.chain, stamp_ns, T_W_B) : std::nullopt;
}

std::optional<SensorMotion> LivePoses::motionAt(const std::string& frame, std::int64_t stamp_ns,
                                                const std::optional<io::WholeMilliseconds>& ms) const {
  const auto T_W_B = poses_.at(stamp_ns);
  if (!T_W_B) return std::nullopt;
  const Route route = routeTo(frame);
  const auto& R_L_W = level_.R_L_W();
  const auto sensor = [&](std::int64_t at_ns, const Eigen::Isometry3d& T_W_B_then) {
    auto T_W_S = sensorAt(route, at_ns, T_W_B_then);
    if (T_W_S && R_L_W) T_W_S = Eigen::Isometry3d(*R_L_W) * *T_W_S;
    return T_W_S;
  };
  const auto T_W_S = sensor(stamp_ns, *T_W_B);
  if (!T_W_S || !level_.isKnown()) return std::nullopt;
  SensorMotion motion;
  motion.T_W_B = *T_W_B;
  motion.T_W_S = *T_W_S;
  if (R_L_W) motion.T_W_registered = Eigen::Isometry3d(*R_L_W);
  if (!ms) return motion;
  motion.first_ms = ms->first;
  for (std::int64_t at = ms->first; at <= ms->last; ++at) {
    const std::int64_t then_ns = stamp_ns + at * 1'000'000;
    const auto T_W_B_then = poses_.at(then_ns);
    motion.T_W_S_at.push_back(T_W_B_then ? sensor(then_ns, *T_W_B_then) : std::nullopt);
  }
  return motion;
}

bool LivePoses::isSettled(const std::string& frame, std::int64_t stamp_ns) const {
  if (ended_) return true;
  if (!level_.isKnown()) return false;
  if (!poses_.isPast(stamp_ns) && !poses_.at(stamp_ns)) return false;
  const Route route = routeTo(frame);
  if (route.direct || poses_.isPast(stamp_ns + kPatience_ns)) return true;
  // Once scans are taken, one in a frame that nothing connects does not keep the others waiting.
  return route.chain ? frames_.isSettled(*route.chain, stamp_ns) : taken_;
}

/// An IMU that names no frame lies as what is posed. One that does must be connected to that by transforms; where none
/// came although there was time, it is taken to lie so, and said.
std::pair<LiveLevel::PoseOfImu, bool> LivePoses::poseOfImu() const {
  const auto ofBody = [this](std::int64_t stamp_ns) { return poses_.at(stamp_ns); };
  const std::string& frame = level_.frame();
  if (frame.empty() || child_.empty() || frame == child_) return {ofBody, true};
  if (const auto chain = frames_.chain(world_frame_->empty() ? io::kWorldFrame : *world_frame_, frame)) {
    return {[this, chain](std::int64_t stamp_ns) {
              const auto T_W_B = poses_.at(stamp_ns);
              return T_W_B ? frames_.at(*chain, stamp_ns, *T_W_B) : std::nullopt;
            },
            true};
  }
  const auto first_ns = level_.firstPosed_ns(ofBody);
  if (ended_ || (first_ns && poses_.isPast(*first_ns + kPatience_ns))) return {ofBody, false};
  return {[](std::int64_t) -> std::optional<Eigen::Isometry3d> { return std::nullopt; }, true};
}

bool LivePoses::levelIsDue() const {
  if (level_.isKnown()) return false;
  if (ended_) return true;
  if (!level_is_due_)
    level_is_due_ = level_.isDue(poseOfImu().first, [this](std::int64_t stamp_ns) { return poses_.isPast(stamp_ns); });
  return *level_is_due_;
}

void LivePoses::findLevel() {
  const auto [T_W_I, connected] = poseOfImu();
  level_.measure(T_W_I);
  if (!connected) unconnected_imu_ = level_.frame();
}

void LivePoses::noteTaken(const std::string& frame, const SensorMotion& motion) {
  taken_ = true;
  extrinsic_m_ = (motion.T_W_registered.inverse() * motion.T_W_S.translation() - motion.T_W_B.translation()).norm();
  const Route route = routeTo(frame);
  if (!route.direct) sensor_chain_ = frames_.inWords(*route.chain);
}

void LivePoses::noteDropped(const std::string& frame) {
  const Route route = routeTo(frame);
  if (!route.direct && !route.chain) unconnected_ = frame;
}

void LivePoses::tell(LiveStatus& status) const {
  status.poses = added_;
  status.poses_invalid = poses_.counts().invalid;
  status.poses_repeated = poses_.counts().repeated;
  status.poses_backwards = poses_.counts().backwards;
  status.poses_other_frame = other_frame_;
  status.world_frame = world_frame_.value_or("");
  status.sensor_chain = sensor_chain_;
  status.unconnected_frame = unconnected_;
  status.unconnected_imu = unconnected_imu_;
  status.waits_for_level = !level_.isKnown();
  status.extrinsic_m = extrinsic_m_;
  frames_.tell(status);
}

}  // namespace accessvdb::internal
