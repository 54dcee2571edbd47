// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which files of a folder are no scans, and which are there twice: found without reading their points.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"
#include "io/clouds/point_cloud.h"

namespace accessvdb::io {

struct ScanCheck {
  std::string flaw;                 ///< "is empty (0 bytes)"; empty for a scan
  std::optional<std::size_t> twin;  ///< another file has the same bytes, and counts
  [[nodiscard]] bool isUsed() const { return flaw.empty() && !twin; }
};

/// One bad file costs that file.
/// @return [files] @throws InputError the first flaw, where most have one; what says nothing of the content
[[nodiscard]] std::vector<ScanCheck> checkScanFiles(const std::vector<std::filesystem::path>& files, ScanKind kind);

/// Adds "scans.skipped" and "scans.repeated", each with the first names.
void warnOfScanFiles(const std::vector<ScanCheck>& checks, const std::vector<std::filesystem::path>& files,
                     std::vector<ScanWarning>& warnings);

}  // namespace accessvdb::io
