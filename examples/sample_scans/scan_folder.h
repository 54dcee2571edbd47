// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes a walk to files, as a recorder would.
#pragma once

#include <filesystem>
#include <functional>

#include "sample_scans/walk_generator.h"

namespace accessvdb::samples {

enum class ScanNames {
  FrameNumber,  ///< 000000.pcd, 000001.pcd, ...
  TimeStamp     ///< the stamp of the pose file: 0000000000.100000.pcd
};

/// Writes one binary PCD per frame (x y z float32, sensor frame), poses.txt (TUM: t x y z qx qy qz qw, sensor to world)
/// and range_noise.txt (sigma in metres, one number) into a folder, created if needed.
/// @param progress  called after each frame with the number written so far; may be empty
/// @throws OutputError if a file cannot be written, or if other PCD files are in the way
void writeScanFolder(const std::filesystem::path& folder, const WalkGenerator& walk,
                     ScanNames names = ScanNames::FrameNumber, const std::function<void(int)>& progress = {});

}  // namespace accessvdb::samples
