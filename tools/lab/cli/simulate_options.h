// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of `simulate`, and the scene, sensor and path that they describe.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "options/command_line.h"
#include "sim/lidar_model.h"
#include "sim/scene.h"
#include "sim/trajectory.h"

namespace accessvdb::tools {

struct SimulateOptions {
  CommonOptions common;
  std::string scene, mesh_unit, trajectory, begin, end, out;
  std::string sensor = "mid360";
  std::optional<int> frames;
  std::optional<double> radius_m, height_m, turns;
  double pitch_deg = 0, tree_height_m = 12, voxel_m = 0.002;
  double range_noise_m = 0, dropout = 0, min_range_m = 0.05;
  std::optional<double> max_range_m;
  std::uint64_t seed = 1;
  bool moving = false;
};

void addSimulateOptions(FlagParser& flags, SimulateOptions& options);

/// Checks what the flags alone determine. @throws InvalidArgument, UnusableInput (no frames), DeviceError
void checkSimulateOptions(const SimulateOptions& options);

/// @throws InvalidArgument
[[nodiscard]] sim::LidarModel lidarModel(const SimulateOptions& options);

/// A scene with its default path, used unless the flags say otherwise.
struct SceneView {
  sim::Scene scene;
  sim::Helix path;
  int frames = 0;
};
/// @throws InvalidArgument for an unknown scene; what makeMeshScene throws
[[nodiscard]] SceneView sceneView(const SimulateOptions& options);

struct SimulatedPath {
  sim::Trajectory poses;     ///< [frames]
  sim::Trajectory stations;  ///< close together along the same path
  nlohmann::ordered_json description;
};
/// @throws InvalidArgument, UnusableInput; InputError for a trajectory file
[[nodiscard]] SimulatedPath simulatedPath(const SimulateOptions& options, const SceneView& view,
                                          const sim::LidarModel& model);

}  // namespace accessvdb::tools
