// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which frame is posed in which (tf), and by which of them one gets from one to another. Poses that do not change are
/// kept here; those that do are the caller's: all of a recording (frame_tree.h), or the latest of a stream.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace accessvdb::io {

/// Names that stand for none: the frame of poses that do not say whose they are, and the one that they are in.
inline const std::string kSensorFrame = "\nsensor", kWorldFrame = "\nworld";

/// Without the slash that older senders begin with.
[[nodiscard]] inline std::string plainFrame(const std::string& name) {
  return name.starts_with('/') ? name.substr(1) : name;
}

class FrameLinks {
 public:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  static constexpr std::size_t kMostFrames = 10'000;

  /// @return the index of the child; nothing if it is its own parent or was posed in another one before: counted
  /// @throws ResourceLimit "limit.recording": more frames than a robot has
  [[nodiscard]] std::optional<std::size_t> link(std::string_view parent, std::string_view child);
  /// Whatever was said before, the child moves in that parent, which is not posed in it.
  std::size_t relink(std::string_view parent, std::string_view child);
  /// Whatever was said before, the frame is posed in none.
  void unlink(const std::string& name);
  /// The frame does not change in its parent any more. @param q  w x y z  @return false if that is no pose
  bool fix(std::size_t frame, const Eigen::Vector3d& p, const Eigen::Vector4d& q);
  [[nodiscard]] bool isFixed(std::size_t frame) const { return frames_[frame].fixed; }

  /// How two frames are connected. Indices of frames, whose poses in their parents are multiplied.
  struct Chain {
    std::vector<std::size_t> from_leaf, from_root;  ///< up to the frame that both have above them
  };
  [[nodiscard]] std::optional<Chain> chain(const std::string& root, const std::string& leaf) const;
  /// T_root_leaf; nothing where a pose of the chain is missing.
  /// @param poseOf  index of a frame that moves -> its pose in its parent, if there is one
  template <typename PoseOf>
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(const Chain& chain, const PoseOf& poseOf) const {
    const auto product = [&](const std::vector<std::size_t>& path) -> std::optional<Eigen::Isometry3d> {
      std::optional<Eigen::Isometry3d> T;
      for (const std::size_t i : path) {
        const auto T_parent = frames_[i].fixed ? std::optional(frames_[i].T_parent) : poseOf(i);
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
  /// Where a frame is on what moves: its fixed transforms up to the first one that is not. Nothing where none moves.
  [[nodiscard]] std::optional<Eigen::Isometry3d> onMovingFrame(const Chain& chain) const;
  /// "map -> odom -> base_link", upwards with "<-".
  [[nodiscard]] std::string inWords(const Chain& chain) const;
  /// "odom -> base_link" for each pose that there is, at most so many.
  [[nodiscard]] std::vector<std::string> edges(std::size_t most) const;
  /// The frame at the top of all that a frame is posed in, itself if that is none; nothing for an unknown one.
  [[nodiscard]] std::optional<std::string> top(const std::string& leaf) const;

  [[nodiscard]] std::size_t size() const { return frames_.size(); }
  [[nodiscard]] std::optional<std::size_t> indexOf(const std::string& name) const;
  [[nodiscard]] std::uint64_t otherParents() const { return other_parents_; }  ///< transforms dropped: a second parent
  [[nodiscard]] std::uint64_t heldBytes() const { return frames_.capacity() * sizeof(Frame); }

 private:
  struct Frame {
    std::string name;
    std::size_t parent = kNone;
    bool fixed = false;
    Eigen::Isometry3d T_parent = Eigen::Isometry3d::Identity();  ///< of a fixed frame
  };

  std::size_t frame(std::string_view name);
  [[nodiscard]] std::vector<std::size_t> pathUp(std::size_t frame) const;

  std::vector<Frame> frames_;
  std::unordered_map<std::string, std::size_t> index_;
  std::uint64_t other_parents_ = 0;
};

}  // namespace accessvdb::io
