// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_level.h"

#include <vector>

#include "io/poses/frame_links.h"

namespace accessvdb::internal {
namespace {

constexpr std::int64_t kRest_ns = 1'000'000'000;
/// No IMU of a robot measures more, in m/s2.
constexpr double kMostForce = 1000;

}  // namespace

LiveLevel::LiveLevel(const std::optional<io::Level>& wanted) : waits_(wanted && wanted->from_imu) {
  if (wanted && !wanted->from_imu) R_L_W_ = io::levellingOf(wanted->roll_rad, wanted->pitch_rad);
}

void LiveLevel::add(const LiveImu& imu) {
  if (!waits_ || !(imu.force.norm() < kMostForce)) return;
  if (samples_.empty()) frame_ = io::plainFrame(imu.frame);
  if (samples_.size() == io::kMostImuSamples) samples_.pop_front();
  samples_.push_back({imu.stamp_ns, imu.force, Eigen::Vector3d::Zero()});
}

std::optional<std::int64_t> LiveLevel::firstPosed_ns(const PoseOfImu& T_W_I) const {
  for (const io::ImuSample& sample : samples_)
    if (T_W_I(sample.stamp_ns)) return sample.stamp_ns;
  return std::nullopt;
}

bool LiveLevel::isDue(const PoseOfImu& T_W_I, const std::function<bool(std::int64_t)>& past) const {
  if (!waits_) return false;
  const auto first_ns = firstPosed_ns(T_W_I);
  return first_ns && past(*first_ns + kRest_ns) && samples_.back().stamp_ns > *first_ns + kRest_ns;
}

void LiveLevel::measure(const PoseOfImu& T_W_I) {
  std::vector<Eigen::Vector3d> force_W;
  const auto first_ns = firstPosed_ns(T_W_I);
  for (const io::ImuSample& sample : samples_) {
    if (!first_ns || sample.stamp_ns - *first_ns > kRest_ns) continue;
    if (const auto T = T_W_I(sample.stamp_ns)) force_W.push_back(T->linear() * sample.force);
  }
  set(io::levellingOf(force_W, "the IMU"));
}

void LiveLevel::set(const Eigen::Matrix3d& R_L_W) {
  R_L_W_ = R_L_W;
  waits_ = false;
  samples_ = {};
}

}  // namespace accessvdb::internal
