// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Simulated scans as they are kept.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "sim/benchmark_scene.h"

namespace accessvdb::eval {

/// The returns of a frame, without rays that hit nothing.
struct StoredFrame {
  std::vector<Eigen::Vector3f> hits_S;
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();
};

struct StoredScans {
  sim::BenchmarkScene benchmark;
  std::vector<StoredFrame> frames;

  [[nodiscard]] std::uint64_t returns() const {
    std::uint64_t count = 0;
    for (const StoredFrame& frame : frames) count += frame.hits_S.size();
    return count;
  }
};

}  // namespace accessvdb::eval
