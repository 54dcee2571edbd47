// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The last poses of something that moves, as they arrive: late, repeated, with gaps and jumps. A recording's poses are
/// all there before the first is asked for; these are asked for while they come (io::PoseTrack gives the same answers).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "io/poses/pose_gap.h"

namespace accessvdb::internal {

class PoseBuffer {
 public:
  struct Counts {
    std::uint64_t invalid = 0, repeated = 0, backwards = 0;
  };

  /// @param most  poses that are kept; those that came first go first, whatever their clock said
  /// @param max_gap_s  longest gap that is interpolated over
  explicit PoseBuffer(std::size_t most, double max_gap_s = io::kMaxPoseGap_s)
      : most_(most), max_gap_ns_(io::nanoseconds(max_gap_s)) {}

  /// @return whether it was kept
  bool add(std::int64_t stamp_ns, const Eigen::Vector3d& p, const Eigen::Quaterniond& q);
  /// Interpolated over gaps of at most max_gap_s, never extrapolated, not over jumps.
  [[nodiscard]] std::optional<Eigen::Isometry3d> at(std::int64_t stamp_ns) const;
  /// Whether poses have got past that time: the last that arrived is later.
  [[nodiscard]] bool isPast(std::int64_t stamp_ns) const { return last_arrived_ns_ && *last_arrived_ns_ > stamp_ns; }
  /// Whether that time is so much later than the pose that arrived last.
  [[nodiscard]] bool isFarAhead(std::int64_t stamp_ns, std::int64_t far_ns) const {
    return last_arrived_ns_ && stamp_ns - *last_arrived_ns_ > far_ns;
  }

  /// From now on no more than that.
  void keepAtMost(std::size_t most);

  [[nodiscard]] const Counts& counts() const { return counts_; }
  [[nodiscard]] std::size_t size() const { return poses_.size(); }

 private:
  struct Entry {
    std::int64_t stamp_ns = 0;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  };

  std::size_t most_;
  std::int64_t max_gap_ns_;
  std::deque<Entry> poses_;              ///< in the order of their stamps, all different
  std::deque<std::int64_t> arrived_ns_;  ///< their stamps in the order in which they came
  std::optional<std::int64_t> last_arrived_ns_;
  Counts counts_;
};

}  // namespace accessvdb::internal
