// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files behind a ScanStore.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "eval/stored_scans.h"
#include "sim/lidar_model.h"

namespace accessvdb::eval {

/// Everything that determines the scans, as text: hashes of mesh and trajectory, the sensor, the seed.
[[nodiscard]] std::string fingerprintOf(const sim::BenchmarkScene& benchmark, const sim::LidarModel& model,
                                        std::uint64_t seed);
/// File name for a key; different keys have different names.
[[nodiscard]] std::string scanFileName(const std::string& key);

/// @param why_not  empty if the file was read, else the reason why it cannot be used
[[nodiscard]] std::vector<StoredFrame> readScanFile(const std::filesystem::path& path, const std::string& fingerprint,
                                                    std::string& why_not);
/// @throws OutputError
void writeScanFile(const std::filesystem::path& path, const std::string& fingerprint,
                   const std::vector<StoredFrame>& frames);

}  // namespace accessvdb::eval
