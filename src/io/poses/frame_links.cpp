// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/frame_links.h"

#include <algorithm>
#include <cmath>

#include "accessvdb/error.h"
#include "io/poses/pose_checks.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// Chains of robots are short; a circle has no end.
constexpr std::size_t kMostDepth = 256;

}  // namespace

std::size_t FrameLinks::frame(std::string_view name) {
  const std::string key(name);
  if (const auto known = index_.find(key); known != index_.end()) return known->second;
  if (frames_.size() >= kMostFrames)
    throw ResourceLimit("limit.recording", "transforms", "name more than " + std::to_string(kMostFrames) + " frames",
                        "Record fewer frames, or use ScanInputOptions::poses with a pose file");
  index_.emplace(key, frames_.size());
  frames_.emplace_back().name = key;
  return frames_.size() - 1;
}

std::optional<std::size_t> FrameLinks::link(std::string_view parent, std::string_view child) {
  const std::size_t above = frame(parent), below = frame(child);
  Frame& frame = frames_[below];
  if (above == below || (frame.parent != kNone && frame.parent != above)) {
    ++other_parents_;
    return std::nullopt;
  }
  frame.parent = above;
  return below;
}

std::size_t FrameLinks::relink(std::string_view parent, std::string_view child) {
  const std::size_t above = frame(parent), below = frame(child);
  frames_[below].parent = above;
  frames_[below].fixed = false;
  if (frames_[above].parent == below) frames_[above].parent = kNone;
  return below;
}

void FrameLinks::unlink(const std::string& name) {
  const auto frame = indexOf(name);
  if (!frame) return;
  frames_[*frame].parent = kNone;
  frames_[*frame].fixed = false;
}

std::optional<std::size_t> FrameLinks::indexOf(const std::string& name) const {
  const auto known = index_.find(name);
  if (known == index_.end()) return std::nullopt;
  return known->second;
}

bool FrameLinks::fix(std::size_t frame, const Eigen::Vector3d& p, const Eigen::Vector4d& q) {
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) <= kRepairLimit)) return false;
  Frame& fixed = frames_[frame];
  fixed.fixed = true;
  fixed.T_parent.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  fixed.T_parent.translation() = p;
  return true;
}

std::vector<std::size_t> FrameLinks::pathUp(std::size_t frame) const {
  std::vector<std::size_t> path;
  for (; frame != kNone && path.size() < kMostDepth; frame = frames_[frame].parent) path.push_back(frame);
  return path;
}

std::optional<FrameLinks::Chain> FrameLinks::chain(const std::string& root, const std::string& leaf) const {
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

std::optional<Eigen::Isometry3d> FrameLinks::onMovingFrame(const Chain& chain) const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  for (const std::size_t i : chain.from_leaf) {
    if (!frames_[i].fixed) return T;
    T = frames_[i].T_parent * T;
  }
  return std::nullopt;
}

std::string FrameLinks::inWords(const Chain& chain) const {
  std::string words;
  for (const std::size_t i : chain.from_root) words += wordForMessage(frames_[i].name) + " <- ";
  const std::vector<std::size_t>& below_top = chain.from_leaf.empty() ? chain.from_root : chain.from_leaf;
  if (!below_top.empty()) words += wordForMessage(frames_[frames_[below_top.back()].parent].name);
  for (auto i = chain.from_leaf.rbegin(); i != chain.from_leaf.rend(); ++i)
    words += " -> " + wordForMessage(frames_[*i].name);
  return words;
}

std::vector<std::string> FrameLinks::edges(std::size_t most) const {
  std::vector<std::string> edges;
  for (const Frame& frame : frames_) {
    if (frame.parent == kNone) continue;
    if (edges.size() >= most) break;
    edges.push_back(frames_[frame.parent].name + " -> " + frame.name);
  }
  return edges;
}

std::optional<std::string> FrameLinks::top(const std::string& leaf) const {
  const auto found = index_.find(leaf);
  if (found == index_.end()) return std::nullopt;
  return frames_[pathUp(found->second).back()].name;
}

}  // namespace accessvdb::io
