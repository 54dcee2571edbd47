// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The frames of a stream (tf), by the rules of recordings (io/poses/frame_tree.h), with bounded memory: names and
/// poses come from whoever can send.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "accessvdb/live_session.h"
#include "io/poses/frame_links.h"
#include "live/pose_buffer.h"

namespace accessvdb::internal {

class LiveFrames {
 public:
  using Chain = io::FrameLinks::Chain;

  LiveFrames(std::size_t most_poses, double max_gap_s) : most_poses_(most_poses), max_gap_s_(max_gap_s) {}

  void add(const LiveTransform& transform);
  /// Poses, not transforms, say from now on where the child is in the world, and nothing says where that is.
  void setPosed(const std::string& world, const std::string& child);

  [[nodiscard]] std::optional<Chain> chain(const std::string& world, const std::string& leaf) const {
    return links_.chain(world, leaf);
  }
  /// T_world_leaf, with what is posed at T_W_B.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(const Chain& chain, std::int64_t stamp_ns,
                                                    const Eigen::Isometry3d& T_W_B) const;
  /// Whether transforms of that time are there or will not come any more.
  [[nodiscard]] bool isSettled(const Chain& chain, std::int64_t stamp_ns) const;
  [[nodiscard]] std::string inWords(const Chain& chain) const { return links_.inWords(chain); }

  void tell(LiveStatus& status) const;

 private:
  std::size_t most_poses_;
  double max_gap_s_;
  io::FrameLinks links_;
  std::map<std::size_t, PoseBuffer> moving_;  ///< by their frames
  std::string world_;
  std::optional<std::size_t> posed_;
  std::uint64_t added_ = 0, invalid_ = 0, unknown_ = 0;
};

}  // namespace accessvdb::internal
