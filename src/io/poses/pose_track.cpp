// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_track.h"

#include <algorithm>
#include <cmath>

#include "io/poses/pose_checks.h"
#include "io/poses/pose_matching.h"

namespace accessvdb::io {
namespace {

constexpr auto kSameStamp_ns = static_cast<std::int64_t>(kSameStamp_s * 1e9);

}  // namespace

Eigen::Isometry3d PoseTrack::Entry::pose() const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  T.translation() = p;
  return T;
}

void PoseTrack::add(std::int64_t stamp_ns, const Eigen::Vector3d& p, const Eigen::Vector4d& q) {
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) <= kRepairLimit) || stamp_ns < -kMostStamp_ns ||
      stamp_ns > kMostStamp_ns) {
    ++counts_.invalid;
    return;
  }
  if (!poses_.empty() && stamp_ns < poses_.back().stamp_ns) ++counts_.backwards;
  Entry entry;
  entry.stamp_ns = stamp_ns;
  entry.p = p;
  entry.q = {q[0], q[1], q[2], q[3]};
  poses_.push_back(entry);
}

void PoseTrack::finish() {
  std::stable_sort(poses_.begin(), poses_.end(),
                   [](const Entry& a, const Entry& b) { return a.stamp_ns < b.stamp_ns; });
  const auto end = std::unique(poses_.begin(), poses_.end(),
                               [](const Entry& a, const Entry& b) { return a.stamp_ns == b.stamp_ns; });
  counts_.repeated += static_cast<std::uint64_t>(poses_.end() - end);
  poses_.erase(end, poses_.end());
  poses_.shrink_to_fit();
  counts_.jumps = 0;
  for (std::size_t i = 0; i + 1 < poses_.size(); ++i) {
    const std::int64_t gap_ns = poses_[i + 1].stamp_ns - poses_[i].stamp_ns;
    const double moved_m = (poses_[i + 1].p - poses_[i].p).norm();
    poses_[i].jumps = gap_ns <= max_gap_ns_ && moved_m > kLeastJump_m && moved_m > kFastest_m_s * seconds(gap_ns);
    if (!poses_[i].jumps) continue;
    if (counts_.jumps++ == 0) counts_.first_jump_ns = poses_[i].stamp_ns;
    counts_.largest_jump_m = std::max(counts_.largest_jump_m, moved_m);
  }
}

void PoseTrack::thin(std::int64_t spacing_ns) {
  const auto end = std::unique(poses_.begin(), poses_.end(), [spacing_ns](const Entry& kept, const Entry& next) {
    return next.stamp_ns >= kept.stamp_ns && next.stamp_ns - kept.stamp_ns < spacing_ns;
  });
  poses_.erase(end, poses_.end());
}

std::optional<Eigen::Isometry3d> PoseTrack::at(std::int64_t stamp_ns) const {
  const auto after = std::lower_bound(poses_.begin(), poses_.end(), stamp_ns,
                                      [](const Entry& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  const auto isSame = [stamp_ns](const Entry& pose) {
    return std::max(pose.stamp_ns, stamp_ns) <= std::min(pose.stamp_ns, stamp_ns) + kSameStamp_ns;
  };
  if (after != poses_.end() && isSame(*after)) return after->pose();
  if (after == poses_.begin()) return std::nullopt;
  const Entry& before = *(after - 1);
  if (isSame(before)) return before.pose();
  if (after == poses_.end() || before.jumps || after->stamp_ns - before.stamp_ns > max_gap_ns_) return std::nullopt;
  const double share =
      static_cast<double>(stamp_ns - before.stamp_ns) / static_cast<double>(after->stamp_ns - before.stamp_ns);
  return interpolateBetween(before.pose(), after->pose(), share);
}

}  // namespace accessvdb::io
