// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans of a walk along +x between two walls with poles, of any length: small files that fill several tiles.
#pragma once

#include <cstdint>
#include <filesystem>

namespace accessvdb::large_test {

struct Walk {
  int scans = 6;
  double step_m = 1.6;  ///< between scans
  int rays = 7000;      ///< of each scan; nearly all of them return
  double max_range_m = 6;
  std::uint64_t seed = 1;
};

/// Writes folder/scans/000000.pcd ... and folder/poses.txt (TUM).
void writeWalk(const std::filesystem::path& folder, const Walk& walk);
/// The same returns as one ray cloud, one sensor position per return.
void writeRayCloud(const std::filesystem::path& file, const Walk& walk);
/// The returns of the first scan, in the world frame, and nothing of the sensor.
void writeCloud(const std::filesystem::path& file, const Walk& walk);
/// Where the sensor of the first scan is, as for --sensor-at.
extern const char* const kFirstSensor;

}  // namespace accessvdb::large_test
