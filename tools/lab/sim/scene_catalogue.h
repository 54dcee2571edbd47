// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The scenes of the paper's tables with their trajectories, six unseen ones, and five for tools that tilt
/// (docs/PAPER.md, "Scenes").
#pragma once

#include <string>
#include <vector>

#include "sim/benchmark_scene.h"

namespace accessvdb::sim {

/// "torus", "sphere_a", "sphere_b", "box", "wall", "ring" (thin: tube radius 1.5 v), or "unseen_1" .. "unseen_6",
/// which are drawn from a fixed seed: no constant of the method was chosen from them; or those of tiltSceneNames().
/// @param voxel_size_m  only the ring depends on it
/// @param frames        0 = as in docs/PAPER.md; else the same path with that many frames
/// @throws InvalidArgument naming the known ones; UnusableInput for a negative number of frames
[[nodiscard]] BenchmarkScene benchmarkScene(const std::string& name, double voxel_size_m, int frames = 0);
[[nodiscard]] std::vector<std::string> benchmarkSceneNames();

}  // namespace accessvdb::sim
