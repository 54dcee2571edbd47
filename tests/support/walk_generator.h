// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The sample-scan generator under the name that tests use.
#pragma once

#include <vector>

#include "sample_scans/scan_folder.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb::test {

using samples::AnalyticScene;
using samples::ScanNames;
using samples::WalkFrame;
using samples::WalkGenerator;
using samples::WalkOptions;
using samples::writeScanFolder;

inline std::vector<WalkFrame> allFrames(const WalkOptions& options) {
  const WalkGenerator walk(options);
  std::vector<WalkFrame> all;
  for (int n = 0; n < walk.frames(); ++n) all.push_back(walk.frame(n));
  return all;
}

/// A few metres past trees, for tests that map a walk several times.
inline WalkOptions shortWalk(int frames, int rays_per_frame) {
  WalkOptions options;
  options.frames = frames;
  options.rays_per_frame = rays_per_frame;
  options.range_noise_m = 0.02;
  options.max_range_m = 8;
  options.length_m = 4;
  return options;
}

}  // namespace accessvdb::test
