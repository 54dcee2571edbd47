// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading pose files: TUM, KITTI, BALM and HBA/MLCC text, and whatever a line of column names explains. All become
/// sensor-to-world transforms.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"

namespace accessvdb::io {

struct PoseEntry {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
  double stamp_s = 0;
  std::size_t index = 0;  ///< place in the file, from 0, or the number that a column gives it
  std::size_t line = 0;   ///< its first line, from 1
};

struct PoseFile {
  std::string subject;  ///< name for messages
  PoseFormat format = PoseFormat::Tum;
  bool stamped = false;                 ///< then stamps increase strictly, except for repeated BALM poses
  bool numbered = false;                ///< a column gives each pose its number
  std::vector<PoseEntry> poses;         ///< not empty
  std::vector<std::string> scan_names;  ///< [PoseEntry::index], then the place, if a column names the files
  std::vector<std::uint64_t> numbers;   ///< [place in the file] of numbered poses, with those that are not poses
  std::size_t written = 0;              ///< in the file, with those that are not poses
  std::vector<std::string> notices;
  std::vector<ScanWarning> warnings;
};

/// One pose that is none (zero, not finite) costs that pose; where half of them are, the file is
/// refused.
/// @param calib  KITTI calib.txt with a line "Tr:" or "Tr_velo_to_cam:", for camera poses; may be empty
/// @param sort_poses  accept stamps that run backwards
/// @throws InputError (unreadable, malformed, empty), UnusableInput (non-finite, not rigid, duplicate, reversed),
///         InvalidArgument (calib with non-KITTI poses, a format that the file's line of names contradicts)
[[nodiscard]] PoseFile readPoseFile(const std::filesystem::path& path, PoseFormat format,
                                    const std::filesystem::path& calib, bool sort_poses);

/// One time in seconds per line, as in KITTI's times.txt. @throws InputError
[[nodiscard]] std::vector<double> readTimes(const std::filesystem::path& path);

}  // namespace accessvdb::io
