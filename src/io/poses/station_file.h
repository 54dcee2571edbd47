// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scanners on tripods: where each stood. One line "file x y z" for each cloud in the world frame.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "io/scans/scan_files.h"

namespace accessvdb::io {

struct StationList {
  ScanFileList scans;                        ///< in the order of the lines
  std::vector<Eigen::Vector3d> positions_W;  ///< [scans.files]
};

/// @param scans     a folder that the names in the file are relative to, or one of the files
/// @param stations  names may contain blanks; a header line "file x y z" is stepped over
/// @throws InputError (unreadable, malformed, a file that does not exist or is no scan), UnusableInput "stations.none",
///         "stations.duplicate", "stations.non_finite", "stations.kinds", "stations.missing"
[[nodiscard]] StationList readStations(const std::filesystem::path& scans, const std::filesystem::path& stations);

}  // namespace accessvdb::io
