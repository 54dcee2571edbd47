// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Simulated scans as files, as a recorder would write them and `accessvdb map` reads them.
#pragma once

#include <filesystem>
#include <functional>

#include "sim/simulator.h"

namespace accessvdb::sim {

struct SimulatedRecordingOptions {
  double range_noise_m = 0;  ///< written next to the scans, for `map` to read
  int threads = 0;           ///< 0 = all
  /// Called between frames, from one thread, with the number written so far; false ends the recording.
  std::function<bool(int)> proceed = {};
};

/// Writes scans/000000.pcd ... (binary, x y z float32, sensor frame; (0,0,0) = no return), poses.txt (TUM: t x y z qx
/// qy qz qw, sensor to world) and range_noise.txt into `folder`, with LidarModel::moves also times.txt (one per scan;
/// the poses are then 5 ms apart, and scans have a field t in ns since their begin), each file whole or not at all.
/// Poses come last and cover only the frames written, so that an interrupted recording can be used.
/// @return frames written; fewer than requested if `proceed` returned false
/// @throws OutputError if a file cannot be written, or if scans of another recording are in the way
int writeRecording(const std::filesystem::path& folder, const Simulator& simulator,
                   const SimulatedRecordingOptions& options);

}  // namespace accessvdb::sim
