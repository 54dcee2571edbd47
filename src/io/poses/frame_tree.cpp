// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/frame_tree.h"

namespace accessvdb::io {

PoseTrack& FrameTree::track(std::size_t frame) {
  while (tracks_.size() <= frame) tracks_.emplace_back(max_gap_ns_);
  return tracks_[frame];
}

void FrameTree::add(std::string_view parent, std::string_view child, std::int64_t stamp_ns, const Eigen::Vector3d& p,
                    const Eigen::Vector4d& q, bool fixed) {
  const auto frame = links_.link(parent, child);
  if (!frame) return;
  if (fixed) {
    invalid_ += links_.fix(*frame, p, q) ? 0 : 1;
    return;
  }
  PoseTrack& moving = track(*frame);
  const std::size_t before = moving.size();
  moving.add(stamp_ns, p, q);
  poses_ += moving.size() - before;
}

void FrameTree::replace(const std::string& parent, const std::string& child, PoseTrack track) {
  this->track(links_.relink(parent, child)) = std::move(track);
}

void FrameTree::finish() {
  for (PoseTrack& track : tracks_) track.finish();
}

void FrameTree::thin(std::int64_t spacing_ns) {
  poses_ = 0;
  for (PoseTrack& track : tracks_) {
    track.thin(spacing_ns);
    poses_ += track.size();
  }
}

std::optional<Eigen::Isometry3d> FrameTree::at(const Chain& chain, std::int64_t stamp_ns) const {
  return links_.at(chain, [&](std::size_t frame) -> std::optional<Eigen::Isometry3d> {
    if (frame >= tracks_.size()) return std::nullopt;
    return tracks_[frame].at(stamp_ns);
  });
}

std::uint64_t FrameTree::invalid() const {
  std::uint64_t invalid = invalid_;
  for (const PoseTrack& track : tracks_) invalid += track.counts().invalid;
  return invalid;
}

std::uint64_t FrameTree::jumps() const {
  std::uint64_t jumps = 0;
  for (const PoseTrack& track : tracks_) jumps += track.counts().jumps;
  return jumps;
}

std::uint64_t FrameTree::heldBytes() const {
  std::uint64_t bytes = links_.heldBytes() + tracks_.capacity() * sizeof(PoseTrack);
  for (const PoseTrack& track : tracks_) bytes += track.heldBytes();
  return bytes;
}

}  // namespace accessvdb::io
