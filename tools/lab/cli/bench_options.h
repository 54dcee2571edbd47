// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of `bench`, and the stream of scans that they describe.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "options/map_options.h"
#include "sim/forest.h"
#include "sim/lidar_model.h"

namespace accessvdb::tools {

struct BenchOptions {
  MapOptions map;  ///< common flags, tool and field settings; the other members are unused
  std::string scene = "pine", path = "flight", out, per_frame;
  int frames = 600, timed_frames = 200, points_per_frame = 20000, budget_points = 0, warm_up_update_every = 1;
  double scans_per_second = 0;  ///< at which timed frames begin; 0 = as fast as possible
  double sensor_rate_hz = 10, range_noise_m = 0.02, min_range_m = 0.2, max_range_m = 30;
  std::optional<double> speed_m_s;        ///< default by path: benchSpeed_m_s()
  std::optional<double> max_new_percent;  ///< the timed part begins no earlier
  std::optional<int> begin_by;            ///< but no later than this frame
  double solid_foliage_m = 0.05;
  std::uint64_t seed = 1, min_surface_points = 0;
  bool shortest = false, pipelined = false;
};

void addBenchOptions(FlagParser& flags, BenchOptions& options);

/// Frames with an update each between a warm-up without and the timed part: what the field remembers of points is then
/// as old as it would be anyway.
[[nodiscard]] inline int settlingFrames(const BenchOptions& options) {
  return options.warm_up_update_every > 1 ? 20 : 0;
}

/// Checks what the flags alone determine. @throws InvalidArgument, DeviceError
void checkBenchOptions(const BenchOptions& options);

/// @throws InvalidArgument
[[nodiscard]] FieldParams benchFieldParams(const BenchOptions& options);
/// A sensor whose frames can each hold points_per_frame returns. @throws InvalidArgument
[[nodiscard]] sim::LidarModel benchSensor(const BenchOptions& options);
[[nodiscard]] sim::ForestParams benchForest(const BenchOptions& options);
[[nodiscard]] double benchSpeed_m_s(const BenchOptions& options);
/// The sensor's poses, one per frame. @throws InvalidArgument
[[nodiscard]] sim::Trajectory benchTrajectory(const BenchOptions& options);

}  // namespace accessvdb::tools
