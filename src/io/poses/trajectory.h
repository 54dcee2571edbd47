// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the sensor was at any time, from a trajectory file: text with time x y z (further columns are ignored, so TUM
/// is one such form), or columns that a header names. World frame of the cloud, metres, seconds.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "io/poses/pose_gap.h"

namespace accessvdb::io {

class Trajectory {
 public:
  struct Node {
    double stamp_s = 0;
    Eigen::Vector3d p_W = Eigen::Vector3d::Zero();
  };

  /// @param sort  accept stamps that run backwards, by sorting them
  /// @param max_gap_s  longest gap between two positions that is interpolated over
  /// @throws InputError (unreadable, malformed), UnusableInput "trajectory.none" (no positions),
  ///         "trajectory.geographic" (degrees), "trajectory.non_finite", "trajectory.reversed", "trajectory.duplicate"
  [[nodiscard]] static Trajectory read(const std::filesystem::path& path, bool sort, double max_gap_s = kMaxPoseGap_s);
  /// @param nodes  not empty, with strictly increasing, finite stamps
  Trajectory(std::vector<Node> nodes, std::string subject, double max_gap_s = kMaxPoseGap_s)
      : nodes_(std::move(nodes)), subject_(std::move(subject)), max_gap_s_(max_gap_s) {}

  /// The position at a time, interpolated over gaps of at most max_gap_s, never extrapolated; nothing for NaN.
  /// @param near  where the last search ended, from 0; makes searches for times in a row fast
  [[nodiscard]] std::optional<Eigen::Vector3d> at(double stamp_s, std::size_t& near) const;

  /// How far apart the positions around a time are; nothing before the first and after the last.
  [[nodiscard]] std::optional<double> gapAt_s(double stamp_s) const;
  [[nodiscard]] double maxGap_s() const { return max_gap_s_; }
  [[nodiscard]] double first_s() const { return nodes_.front().stamp_s; }
  [[nodiscard]] double last_s() const { return nodes_.back().stamp_s; }
  [[nodiscard]] std::size_t size() const { return nodes_.size(); }
  [[nodiscard]] std::uint64_t heldBytes() const { return nodes_.capacity() * sizeof(Node); }
  [[nodiscard]] const std::string& subject() const { return subject_; }  ///< the file's name for messages
  [[nodiscard]] const std::vector<std::string>& notices() const { return notices_; }

 private:
  std::vector<Node> nodes_;
  std::string subject_;
  double max_gap_s_;
  std::vector<std::string> notices_;
};

}  // namespace accessvdb::io
