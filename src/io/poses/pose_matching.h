// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which pose belongs to which scan. The rules are tried in a fixed order, and the one that fits is reported:
///   1. file number = pose index, from 0 (BALM, HBA, KITTI);
///   2. file stem = time stamp, poses interpolated over gaps of at most 0.2 s, never extrapolated;
///   3. times.txt gives the stamps of the scans;
///   4. same number of scans and poses: in order.
/// Names that are time stamps, for poses with stamps, skip rule 1: their last digits are not an index.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "io/poses/pose_files.h"

namespace accessvdb::io {

/// Longest gap between two poses that is interpolated over.
inline constexpr double kMaxPoseGap_s = 0.2;
/// A stamp this close to a pose's is that pose's: both were rounded when written, to 5 digits or more.
inline constexpr double kSameStamp_s = 1e-5;

struct MatchedScan {
  std::size_t scan = 0;  ///< index of the file
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  double stamp_s = 0;  ///< 0 where unknown
};

struct MatchResult {
  std::vector<MatchedScan> scans;  ///< not empty, in the order of the files
  std::string rule;
  std::vector<std::string> notices;
};

/// The last run of digits of a file stem.
[[nodiscard]] std::optional<std::uint64_t> fileNumber(const std::string& stem);
/// The time at the end of a file stem: digits with a point, or at least 10 digits not beginning with 0 (seconds, or
/// milli-, micro-, nanoseconds by their number). Shorter whole numbers are numbers, not times.
[[nodiscard]] std::optional<double> fileStamp_s(const std::string& stem);

/// @param share  0 = before, 1 = after
[[nodiscard]] Eigen::Isometry3d interpolateBetween(const Eigen::Isometry3d& before, const Eigen::Isometry3d& after,
                                                   double share);

/// The pose at a given time. @param poses  with increasing stamps
[[nodiscard]] std::optional<Eigen::Isometry3d> interpolatePose(const std::vector<PoseEntry>& poses, double stamp_s);

/// @param stems  file names without extension, in order
/// @param times  from times.txt, empty if there is none
/// @param times_name  for messages
/// @param time_offset_s  added to the times of the scans
/// @throws UnusableInput "poses.no_overlap", "poses.too_few", "poses.no_match" with both counts and spans;
///         InvalidArgument "usage.time_offset" for scans that are matched without times
[[nodiscard]] MatchResult matchPoses(const std::vector<std::string>& stems, const PoseFile& poses,
                                     const std::vector<double>& times, const std::string& times_name,
                                     double time_offset_s = 0);

}  // namespace accessvdb::io
