// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/frame_tree.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kMostFrames = 10'000;
/// Chains of robots are short; a circle has no end.
constexpr std::size_t kMostDepth = 256;

}  // namespace

std::size_t FrameTree::frame(std::string_view name) {
  const std::string key(name);
  if (const auto known = index_.find(key); known != index_.end()) return known->second;
  if (frames_.size() >= kMostFrames)
    throw ResourceLimit("limit.recording", "transforms", "name more than " + std::to_string(kMostFrames) + " frames",
                        "Record fewer frames, or use ScanInputOptions::poses with a pose file");
  index_.emplace(key, frames_.size());
  frames_.emplace_back(max_gap_ns_);
  frames_.back().name = key;
  return frames_.size() - 1;
}

void FrameTree::add(std::string_view parent, std::string_view child, std::int64_t stamp_ns, const Eigen::Vector3d& p,
                    const Eigen::Vector4d& q, bool fixed) {
  const std::size_t above = frame(parent), below = frame(child);
  Frame& frame = frames_[below];
  if (above == below || (frame.parent != kNone && frame.parent != above)) {
    ++other_parents_;
    return;
  }
  frame.parent = above;
  if (!fixed) {
    const std::size_t before = frame.track.size();
    frame.track.add(stamp_ns, p, q);
    poses_ += frame.track.size() - before;
    return;
  }
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) <= kRepairLimit)) {
    ++invalid_;
    return;
  }
  frame.fixed = true;
  frame.T_parent.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  frame.T_parent.translation() = p;
}

void FrameTree::replace(const std::string& parent, const std::string& child, PoseTrack track) {
  const std::size_t above = frame(parent), below = frame(child);
  Frame& frame = frames_[below];
  frame.parent = above;
  frame.fixed = false;
  frame.track = std::move(track);
  // The odometry's own frame may have been posed in the other direction.
  if (frames_[above].parent == below) frames_[above].parent = kNone;
}

void FrameTree::finish() {
  for (Frame& frame : frames_) frame.track.finish();
}

void FrameTree::thin(std::int64_t spacing_ns) {
  poses_ = 0;
  for (Frame& frame : frames_) {
    frame.track.thin(spacing_ns);
    poses_ += frame.track.size();
  }
}

std::vector<std::size_t> FrameTree::pathUp(std::size_t frame) const {
  std::vector<std::size_t> path;
  for (; frame != kNone && path.size() < kMostDepth; frame = frames_[frame].parent) path.push_back(frame);
  return path;
}

std::optional<FrameTree::Chain> FrameTree::chain(const std::string& root, const std::string& leaf) const {
  if (root == leaf) return Chain{};
  const auto from = index_.find(root), to = index_.find(leaf);
  if (from == index_.end() || to == index_.end()) return std::nullopt;
  const std::vector<std::size_t> up_root = pathUp(from->second), up_leaf = pathUp(to->second);
  for (std::size_t i = 0; i < up_leaf.size(); ++i) {
    const auto met = std::find(up_root.begin(), up_root.end(), up_leaf[i]);
    if (met == up_root.end()) continue;
    Chain chain;
    chain.from_leaf.assign(up_leaf.begin(), up_leaf.begin() + static_cast<std::ptrdiff_t>(i));
    chain.from_root.assign(up_root.begin(), met);
    return chain;
  }
  return std::nullopt;
}

std::optional<Eigen::Isometry3d> FrameTree::at(const Chain& chain, std::int64_t stamp_ns) const {
  const auto product = [&](const std::vector<std::size_t>& path) -> std::optional<Eigen::Isometry3d> {
    std::optional<Eigen::Isometry3d> T;
    for (const std::size_t i : path) {
      const Frame& frame = frames_[i];
      const auto T_parent = frame.fixed ? std::optional(frame.T_parent) : frame.track.at(stamp_ns);
      if (!T_parent) return std::nullopt;
      T = T ? *T_parent * *T : *T_parent;
    }
    return T.value_or(Eigen::Isometry3d::Identity());
  };
  const auto T_top_leaf = product(chain.from_leaf);
  if (!T_top_leaf || chain.from_root.empty()) return T_top_leaf;
  const auto T_top_root = product(chain.from_root);
  if (!T_top_root) return std::nullopt;
  return T_top_root->inverse(Eigen::Isometry) * *T_top_leaf;
}

std::optional<Eigen::Isometry3d> FrameTree::onMovingFrame(const Chain& chain) const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (const std::size_t i : chain.from_leaf) {
    if (!frames_[i].fixed) return T;
    T = frames_[i].T_parent * T;
  }
  return std::nullopt;
}

std::string FrameTree::inWords(const Chain& chain) const {
  std::string words;
  for (const std::size_t i : chain.from_root) words += wordForMessage(frames_[i].name) + " <- ";
  const std::vector<std::size_t>& below_top = chain.from_leaf.empty() ? chain.from_root : chain.from_leaf;
  if (!below_top.empty()) words += wordForMessage(frames_[frames_[below_top.back()].parent].name);
  for (auto i = chain.from_leaf.rbegin(); i != chain.from_leaf.rend(); ++i)
    words += " -> " + wordForMessage(frames_[*i].name);
  return words;
}

std::vector<std::string> FrameTree::edges(std::size_t most) const {
  std::vector<std::string> edges;
  for (const Frame& frame : frames_) {
    if (frame.parent == kNone) continue;
    if (edges.size() >= most) break;
    edges.push_back(frames_[frame.parent].name + " -> " + frame.name);
  }
  return edges;
}

std::optional<std::string> FrameTree::top(const std::string& leaf) const {
  const auto found = index_.find(leaf);
  if (found == index_.end()) return std::nullopt;
  return frames_[pathUp(found->second).back()].name;
}

std::uint64_t FrameTree::invalid() const {
  std::uint64_t invalid = invalid_;
  for (const Frame& frame : frames_) invalid += frame.track.counts().invalid;
  return invalid;
}

std::uint64_t FrameTree::jumps() const {
  std::uint64_t jumps = 0;
  for (const Frame& frame : frames_) jumps += frame.track.counts().jumps;
  return jumps;
}

std::uint64_t FrameTree::heldBytes() const {
  std::uint64_t bytes = frames_.capacity() * sizeof(Frame);
  for (const Frame& frame : frames_) bytes += frame.track.heldBytes();
  return bytes;
}

}  // namespace accessvdb::io
