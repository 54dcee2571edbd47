// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "live/live_frames.h"

#include <algorithm>
#include <cmath>

#include "io/poses/pose_checks.h"
#include "io/poses/pose_track.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kMostFrames = 1000, kMostNameBytes = 256;
/// Poses that are kept of all frames together, in units of those of one.
constexpr std::size_t kSharedBy = 16;

bool isPose(const LiveTransform& transform) {
  return transform.p.allFinite() && std::abs(transform.q.norm() - 1.0) <= io::kRepairLimit &&
         (transform.fixed || (transform.stamp_ns >= -io::kMostStamp_ns && transform.stamp_ns <= io::kMostStamp_ns));
}

}  // namespace

void LiveFrames::add(const LiveTransform& transform) {
  ++added_;
  const std::string parent = io::plainFrame(transform.parent), child = io::plainFrame(transform.child);
  // One that is no pose must not connect anything either.
  if (parent.empty() || child.empty() || std::max(parent.size(), child.size()) > kMostNameBytes || !isPose(transform)) {
    ++invalid_;
    return;
  }
  if (posed_ && child == world_) return;                  // at the top is what poses are in
  if (posed_ && links_.indexOf(child) == posed_) return;  // and poses say where that is
  const std::size_t fresh = (links_.indexOf(parent) ? 0 : 1) + (links_.indexOf(child) ? 0 : 1);
  if (links_.size() + fresh > kMostFrames) {
    ++unknown_;
    return;
  }
  const Eigen::Vector4d q(transform.q.w(), transform.q.x(), transform.q.y(), transform.q.z());
  const auto frame = links_.link(parent, child);
  if (!frame) return;
  if (transform.fixed) {
    invalid_ += links_.fix(*frame, transform.p, q) ? 0 : 1;
    return;
  }
  const auto [known, added] = moving_.try_emplace(*frame, most_poses_, max_gap_s_);
  if (added) {
    const std::size_t share = std::max<std::size_t>(2, kSharedBy * most_poses_ / moving_.size());
    if (share < most_poses_)
      for (auto& [index, poses] : moving_) poses.keepAtMost(share);
  }
  known->second.add(transform.stamp_ns, transform.p, transform.q);
}

void LiveFrames::setPosed(const std::string& world, const std::string& child) {
  world_ = world;
  posed_ = links_.relink(world, child);
  links_.unlink(world);
}

std::optional<Eigen::Isometry3d> LiveFrames::at(const Chain& chain, std::int64_t stamp_ns,
                                                const Eigen::Isometry3d& T_W_B) const {
  return links_.at(chain, [&](std::size_t frame) -> std::optional<Eigen::Isometry3d> {
    if (frame == posed_) return T_W_B;
    const auto known = moving_.find(frame);
    return known == moving_.end() ? std::nullopt : known->second.at(stamp_ns);
  });
}

bool LiveFrames::isSettled(const Chain& chain, std::int64_t stamp_ns) const {
  return std::all_of(chain.from_leaf.begin(), chain.from_leaf.end(), [&](std::size_t frame) {
    const auto known = moving_.find(frame);
    return frame == posed_ || links_.isFixed(frame) ||
           (known != moving_.end() && (known->second.isPast(stamp_ns) || known->second.at(stamp_ns)));
  });
}

void LiveFrames::tell(LiveStatus& status) const {
  status.transforms = added_;
  status.transforms_invalid = invalid_;
  for (const auto& [frame, poses] : moving_) status.transforms_invalid += poses.counts().invalid;
  status.transforms_other_parent = links_.otherParents() + unknown_;
}

}  // namespace accessvdb::internal
