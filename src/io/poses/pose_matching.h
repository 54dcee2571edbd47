// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which pose belongs to which scan. The rules are tried in a fixed order, and the one that fits is reported:
///   1. file number = pose index, from 0 (BALM, HBA, KITTI), or = the number or name that the pose file gives
///   (Match::Name);
///   2. file stem = time stamp, poses interpolated over short gaps, never extrapolated (Match::Time);
///   3. times.txt gives the stamps of the scans (Match::Time);
///   4. same number of scans and poses: in order (Match::Order).
/// Names that are time stamps, for poses with stamps, skip rule 1: their last digits are not an index.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "io/poses/file_stamps.h"
#include "io/poses/pose_files.h"
#include "io/poses/pose_gap.h"

namespace accessvdb::io {

struct MatchedScan {
  std::size_t scan = 0;  ///< index of the file
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  double stamp_s = 0;  ///< 0 where unknown
};

struct MatchResult {
  std::vector<MatchedScan> scans;  ///< not empty, in the order of the files
  std::string rule;
  std::vector<std::string> notices;
  std::vector<ScanWarning> warnings;
};

/// @param share  0 = before, 1 = after
[[nodiscard]] Eigen::Isometry3d interpolateBetween(const Eigen::Isometry3d& before, const Eigen::Isometry3d& after,
                                                   double share);

/// The pose at a given time. @param poses  with increasing stamps
[[nodiscard]] std::optional<Eigen::Isometry3d> interpolatePose(const std::vector<PoseEntry>& poses, double stamp_s,
                                                               double max_gap_s = kMaxPoseGap_s);
/// How far apart the poses around a time are; nothing before the first and after the last.
[[nodiscard]] std::optional<double> poseGapAt_s(const std::vector<PoseEntry>& poses, double stamp_s);
/// What to do about scans that have no pose: a longer gap if that helps, or nothing.
[[nodiscard]] std::string adviceForGaps(const std::vector<PoseEntry>& poses, const std::vector<double>& unposed_s,
                                        double max_gap_s);

struct MatchRequest {
  Match match = Match::Auto;
  double time_offset_s = 0;  ///< added to the times of the scans
  double max_gap_s = kMaxPoseGap_s;
};

/// @param stems  file names without extension, in order
/// @param times  from times.txt, empty if there is none
/// @param times_name  for messages
/// @throws UnusableInput "poses.no_overlap", "poses.too_few", "poses.no_match" with both counts and spans;
///         InvalidArgument "usage.time_offset" for scans that are matched without times
[[nodiscard]] MatchResult matchPoses(const std::vector<std::string>& stems, const PoseFile& poses,
                                     const std::vector<double>& times, const std::string& times_name,
                                     const MatchRequest& request = {});

}  // namespace accessvdb::io
