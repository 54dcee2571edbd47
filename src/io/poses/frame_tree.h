// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frames of a recording (tf): which is posed in which, and how, over time.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "io/poses/pose_track.h"

namespace accessvdb::io {

class FrameTree {
 public:
  explicit FrameTree(std::int64_t max_gap_ns = nanoseconds(kMaxPoseGap_s))
      : max_gap_ns_(max_gap_ns) {}  ///< PoseTrack's
  /// @param fixed  does not change over time (tf_static); the last one counts
  /// @throws ResourceLimit "limit.recording": more frames than a robot has
  void add(std::string_view parent, std::string_view child, std::int64_t stamp_ns, const Eigen::Vector3d& p,
           const Eigen::Vector4d& q, bool fixed);
  /// Odometry: takes the place of what transforms say of that frame.
  void replace(const std::string& parent, const std::string& child, PoseTrack track);
  void finish();  ///< after the last add() and replace()

  /// How two frames are connected. Indices of frames, whose poses in their parents are multiplied.
  struct Chain {
    std::vector<std::size_t> from_leaf, from_root;  ///< up to the frame that both have above them
  };
  [[nodiscard]] std::optional<Chain> chain(const std::string& root, const std::string& leaf) const;
  /// T_root_leaf at a time; nothing where a pose of the chain is missing then.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(const Chain& chain, std::int64_t stamp_ns) const;
  /// Where a frame is on what moves: its fixed transforms up to the first one that is not. Nothing where none moves.
  [[nodiscard]] std::optional<Eigen::Isometry3d> onMovingFrame(const Chain& chain) const;
  /// "map -> odom -> base_link", upwards with "<-".
  [[nodiscard]] std::string inWords(const Chain& chain) const;
  /// "odom -> base_link" for each pose that there is, at most so many.
  [[nodiscard]] std::vector<std::string> edges(std::size_t most) const;

  [[nodiscard]] bool empty() const { return frames_.empty(); }
  /// The frame at the top of all that a frame is posed in, itself if that is none; nothing for an unknown one.
  [[nodiscard]] std::optional<std::string> top(const std::string& leaf) const;
  [[nodiscard]] std::uint64_t otherParents() const { return other_parents_; }  ///< transforms dropped: a second parent
  [[nodiscard]] std::uint64_t invalid() const;
  [[nodiscard]] std::uint64_t jumps() const;  ///< see PoseTrack; after finish()
  [[nodiscard]] std::uint64_t heldBytes() const;
  [[nodiscard]] std::size_t poses() const { return poses_; }
  void thin(std::int64_t spacing_ns);

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  struct Frame {
    std::string name;
    std::size_t parent = kNone;
    bool fixed = false;
    Eigen::Isometry3d T_parent = Eigen::Isometry3d::Identity();  ///< of a fixed frame
    PoseTrack track;                                             ///< of others
    explicit Frame(std::int64_t max_gap_ns) : track(max_gap_ns) {}
  };

  std::size_t frame(std::string_view name);
  [[nodiscard]] std::vector<std::size_t> pathUp(std::size_t frame) const;

  std::int64_t max_gap_ns_;
  std::vector<Frame> frames_;
  std::unordered_map<std::string, std::size_t> index_;
  std::uint64_t other_parents_ = 0, invalid_ = 0;
  std::size_t poses_ = 0;
};

}  // namespace accessvdb::io
