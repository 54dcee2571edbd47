// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A scene of the benchmarks.
#pragma once

#include "sim/scene.h"
#include "sim/trajectory.h"

namespace accessvdb::sim {

/// A scene and its viewpoints.
struct BenchmarkScene {
  Scene scene;
  Helix path;             ///< what the trajectory follows
  int frames = 0;         ///< number of poses
  Trajectory trajectory;  ///< [frames]
};

}  // namespace accessvdb::sim
