// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Simulated scans, made once and used by many tables; in memory, and in a folder if one is named.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "eval/observer.h"
#include "eval/stored_scans.h"
#include "sim/lidar_model.h"

namespace accessvdb::eval {

/// Which scans: everything that they depend on besides this program.
struct ScanRequest {
  std::string scene;           ///< name for sim::benchmarkScene()
  double voxel_size_m = 0.01;  ///< only the ring depends on it
  int frames = 0;              ///< 0 = the benchmark's
  double range_noise_m = 0;
  std::uint64_t seed = 1;
};

class ScanStore {
 public:
  /// @param folder  where scans are kept between runs; empty = nowhere. A file is used only if its key (format version,
  /// mesh, trajectory, sensor, noise, seed) and checksum match and two of its frames, cast again, are the same bytes;
  /// otherwise one line gives the reason, and it is made again. @throws OutputError
  explicit ScanStore(std::filesystem::path folder, Observer observer);

  /// @throws StopRequested, what the simulator throws, OutputError
  std::shared_ptr<const StoredScans> get(const ScanRequest& request);

 private:
  std::filesystem::path folder_;
  Observer observer_;
  std::map<std::string, std::shared_ptr<const StoredScans>> scans_;
};

/// The same for scans of any scene: for tests and the pine.
[[nodiscard]] std::vector<StoredFrame> simulateFrames(const sim::Scene& scene, const sim::Trajectory& trajectory,
                                                      const sim::LidarModel& model, std::uint64_t seed,
                                                      const Observer& observer);

}  // namespace accessvdb::eval
