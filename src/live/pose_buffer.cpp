// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/pose_buffer.h"

#include <algorithm>
#include <cmath>

#include "io/poses/pose_checks.h"
#include "io/poses/pose_matching.h"
#include "io/poses/pose_track.h"

namespace accessvdb::internal {
namespace {

constexpr auto kSameStamp_ns = static_cast<std::int64_t>(io::kSameStamp_s * 1e9);

/// Stamps are below io::kMostStamp_ns in size, so differences do not overflow.
bool isSame(std::int64_t a_ns, std::int64_t b_ns) { return std::abs(a_ns - b_ns) <= kSameStamp_ns; }

}  // namespace

bool PoseBuffer::add(std::int64_t stamp_ns, const Eigen::Vector3d& p, const Eigen::Quaterniond& q) {
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) <= io::kRepairLimit) || stamp_ns < -io::kMostStamp_ns ||
      stamp_ns > io::kMostStamp_ns) {
    ++counts_.invalid;
    return false;
  }
  if (last_arrived_ns_ && stamp_ns < *last_arrived_ns_) ++counts_.backwards;
  last_arrived_ns_ = stamp_ns;
  const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp_ns,
                                      [](const Entry& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  if (after != poses_.end() && after->stamp_ns == stamp_ns) {
    ++counts_.repeated;
    return false;
  }
  Entry entry;
  entry.stamp_ns = stamp_ns;
  entry.T.linear() = q.normalized().toRotationMatrix();
  entry.T.translation() = p;
  poses_.insert(after, entry);
  arrived_ns_.push_back(stamp_ns);
  keepAtMost(most_);
  return true;
}

void PoseBuffer::keepAtMost(std::size_t most) {
  most_ = most;
  while (poses_.size() > most_) {
    const std::int64_t oldest_ns = arrived_ns_.front();
    arrived_ns_.pop_front();
    poses_.erase(std::lower_bound(poses_.begin(), poses_.end(), oldest_ns,
                                  [](const Entry& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; }));
  }
}

std::optional<Eigen::Isometry3d> PoseBuffer::at(std::int64_t stamp_ns) const {
  const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp_ns,
                                      [](const Entry& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  if (after != poses_.end() && isSame(after->stamp_ns, stamp_ns)) return after->T;
  if (after == poses_.begin()) return std::nullopt;
  const Entry& before = *(after - 1);
  if (isSame(before.stamp_ns, stamp_ns)) return before.T;
  if (after == poses_.end()) return std::nullopt;
  const std::int64_t gap_ns = after->stamp_ns - before.stamp_ns;
  const double moved_m = (after->T.translation() - before.T.translation()).norm();
  const bool jumps = moved_m > io::kLeastJump_m && moved_m > io::kFastest_m_s * io::seconds(gap_ns);
  if (gap_ns > max_gap_ns_ || jumps) return std::nullopt;
  const double share = static_cast<double>(stamp_ns - before.stamp_ns) / static_cast<double>(gap_ns);
  return io::interpolateBetween(before.T, after->T, share);
}

}  // namespace accessvdb::internal
