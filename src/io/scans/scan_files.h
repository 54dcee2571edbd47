// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lists scan files, in natural order.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/clouds/point_cloud.h"

namespace accessvdb::io {

struct ScanFileList {
  std::vector<std::filesystem::path> files;  ///< not empty
  ScanKind kind = ScanKind::Pcd;             ///< of all files
  std::filesystem::path folder;              ///< the folder of the files
  bool whole_folder = false;                 ///< a folder was given, not one file
  std::vector<std::string> notices;
};

/// full9 before full10: runs of digits are compared by value.
[[nodiscard]] bool naturalLess(std::string_view a, std::string_view b);

/// The scans of a folder, of the one sub-folder with scans if it has none itself, or one file.
/// @throws InputError (no scans, unknown kind)
[[nodiscard]] ScanFileList listScans(const std::filesystem::path& path);
/// One file. @throws InputError (missing, no regular file, unknown kind)
[[nodiscard]] ScanFileList listScanFile(const std::filesystem::path& path);
/// The files of one kind directly in a folder, in natural order. @throws InputError
[[nodiscard]] std::vector<std::filesystem::path> scanFilesIn(const std::filesystem::path& folder, ScanKind kind);

}  // namespace accessvdb::io
