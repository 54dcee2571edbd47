// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One pose for each scan of a list, from the source that the options name: a pose file, VIEWPOINT lines, or none if
/// not needed.
#pragma once

#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/poses/pose_matching.h"
#include "io/scans/scan_files.h"

namespace accessvdb::io {

struct ScanPoses {
  MatchResult match;
  bool stamped = false;                      ///< the match has time stamps
  std::vector<PoseEntry> track;              ///< if stamped: all poses, in the order of their stamps
  std::vector<std::filesystem::path> files;  ///< read on the way: poses, calibration, times
  std::vector<std::string> notices;          ///< about the poses; those of the match are in the match
  std::vector<ScanWarning> warnings;         ///< of both
};

/// A file with that name next to the scans: in their folder, or in the folder above as in KITTI's layout.
[[nodiscard]] std::optional<std::filesystem::path> besideScans(const ScanFileList& scans, const std::string& name);

/// @throws as ScanSequence::open
[[nodiscard]] ScanPoses posesForScans(const ScanFileList& scans, const ScanInputOptions& options);

}  // namespace accessvdb::io
