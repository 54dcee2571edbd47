// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frames of a recording (tf): which is posed in which, and how, over time.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/poses/frame_links.h"
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

  using Chain = FrameLinks::Chain;
  [[nodiscard]] const FrameLinks& links() const { return links_; }
  [[nodiscard]] std::optional<Chain> chain(const std::string& root, const std::string& leaf) const {
    return links_.chain(root, leaf);
  }
  /// T_root_leaf at a time; nothing where a pose of the chain is missing then.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(const Chain& chain, std::int64_t stamp_ns) const;

  [[nodiscard]] bool empty() const { return links_.size() == 0; }
  [[nodiscard]] std::uint64_t invalid() const;
  [[nodiscard]] std::uint64_t jumps() const;  ///< see PoseTrack; after finish()
  [[nodiscard]] std::uint64_t heldBytes() const;
  [[nodiscard]] std::size_t poses() const { return poses_; }
  void thin(std::int64_t spacing_ns);

 private:
  PoseTrack& track(std::size_t frame);

  std::int64_t max_gap_ns_;
  FrameLinks links_;
  std::vector<PoseTrack> tracks_;  ///< [frames]; empty of those that do not move
  std::uint64_t invalid_ = 0;
  std::size_t poses_ = 0;
};

}  // namespace accessvdb::io
