// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Walks there and back through boards and poles, for rolling fields and what they are compared with.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/rolling_field.h"
#include "accessvdb/tiles.h"
#include "accessvdb/tool_spec.h"
#include "state_streams.h"
#include "support/box_tool.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"
#include "tiles/disk_thread.h"

namespace accessvdb::test {

using tiles::DiskThread;
using Pace = DiskThread::Pace;

/// Of the fields that are made while it lives.
class WithPace {
 public:
  explicit WithPace(Pace pace) { DiskThread::setPaceForTests(pace); }
  ~WithPace() { DiskThread::setPaceForTests(Pace::Beside); }
};

struct Case {
  std::string name;
  std::uint64_t seed = 1;
  ChangeMode change = ChangeMode::Off;
  int update_every = 1;  ///< 0: only at the end
  int tools = 1;
  bool ray_cloud = false;
  double memory_share = 0.7;  ///< of what all tiles take
  double free_for_s = std::numeric_limits<double>::infinity();
  double spacing_m = 0;  ///< of the points that are scored; 0: all are
};
inline void PrintTo(const Case& test, std::ostream* out) { *out << test.name; }

/// ACCESSVDB_ROLLING_WORLDS: so many more.
inline int worlds(int otherwise) {
  const char* given = std::getenv("ACCESSVDB_ROLLING_WORLDS");
  return given != nullptr ? std::atoi(given) : otherwise;
}

inline constexpr double kVoxel_m = 0.05;
inline constexpr std::int32_t kTile_voxels = 128;

struct Step {
  std::vector<Eigen::Vector3d> points_W, sensors_W;
};

/// Two walls along a way of 30 m that is walked there and back, and boards before them, most of which go: while they
/// are seen, or between two visits. Some stand somewhere else from then on. Rays end on what they meet first, so those
/// that go on to the wall are evidence; every fifth scan sees only what is far, across tiles without a return.
inline std::vector<Step> walkPastWhatGoes(const Case& test, int steps = 40) {
  constexpr double kWall_m = 4.5, kHalfWay_m = 15;
  std::mt19937_64 random(test.seed);
  struct Board {
    Eigen::Vector3d corner, along, up;
    int from, until;  ///< steps in which it is there
  };
  std::vector<Board> boards;
  const auto at = [&](Eigen::Vector3d corner, double heading, int from, int until) {
    const double length = uniform(random, 0.3, 1);
    boards.push_back({corner,
                      {length * std::cos(heading), length * std::sin(heading), 0},
                      {0, 0, uniform(random, 0.3, 1)},
                      from,
                      until});
  };
  for (int n = 0; n < 70; ++n) {
    // Near the way, where rays pass on to what is far, or near the wall; often with another one close behind it.
    const double side = random() % 2 == 0 ? 1 : -1,
                 away = random() % 3 == 0 ? uniform(random, 0.7, 1.6) : uniform(random, 2.8, 4);
    const Eigen::Vector3d corner(uniform(random, -kHalfWay_m, kHalfWay_m), away * side, uniform(random, -0.8, 0));
    const int until = random() % 4 == 0 ? steps : static_cast<int>(uniform(random, 0.15, 0.85) * steps);
    at(corner, uniform(random, -0.5, 0.5), 0, until);
    if (random() % 3 == 0) at(corner + Eigen::Vector3d(uniform(random, -1, 1), 0, 0), 0, until, steps);
    if (random() % 2 == 0) at(corner + Eigen::Vector3d(0.1, uniform(random, 0.3, 0.5) * side, 0), 0, 0, steps);
  }
  /// From 0 at the sensor to 1 at the end; 1 if the board is not on the way.
  const auto meets = [](const Board& board, const Eigen::Vector3d& from, const Eigen::Vector3d& way) {
    Eigen::Matrix3d axes;
    axes << way, -board.along, -board.up;
    if (std::abs(axes.determinant()) < 1e-9) return 1.0;
    const Eigen::Vector3d x = axes.inverse() * (board.corner - from);
    const bool on = x[1] >= 0 && x[1] <= 1 && x[2] >= 0 && x[2] <= 1;
    return on && x[0] > 0 ? std::min(x[0], 1.0) : 1.0;
  };
  std::vector<Step> walk;
  for (int s = 0; s < steps; ++s) {
    Step& step = walk.emplace_back();
    const double way = 2.0 * s / steps, x = kHalfWay_m * (way <= 1 ? 2 * way - 1 : 3 - 2 * way);
    const Eigen::Vector3d sensor_W(x, uniform(random, -0.5, 0.5), uniform(random, 0, 0.5));
    std::vector<Board> near;
    for (const Board& board : boards)
      if (s >= board.from && s < board.until && std::abs(board.corner.x() - x) < 10.5) near.push_back(board);
    for (int n = 0; n < 8000; ++n) {
      const double far = s % 5 == 3 ? uniform(random, 6.5, 9.5) * (random() % 2 == 0 ? 1 : -1) : uniform(random, -4, 4);
      const Eigen::Vector3d end(x + far, random() % 2 == 0 ? kWall_m : -kWall_m, uniform(random, -1, 1.5));
      double part = 1;
      for (const Board& board : near) part = std::min(part, meets(board, sensor_W, end - sensor_W));
      if (s % 11 == 7 && part == 1) continue;  // an open gate: nothing but what stands before it
      const Eigen::Vector3d noise(uniform(random, -0.02, 0.02), uniform(random, -0.02, 0.02),
                                  uniform(random, -0.02, 0.02));
      step.points_W.push_back(sensor_W + part * (end - sensor_W) + noise);
      if (test.ray_cloud) step.sensors_W.push_back(sensor_W + Eigen::Vector3d(1e-5 * n, 0, 0));
    }
    if (step.sensors_W.empty()) step.sensors_W.push_back(sensor_W);
  }
  return walk;
}

/// Boards and poles along a way of 40 m that is walked there and back, with what stands near the sensor seen.
inline std::vector<Step> walk(const Case& test, int steps = 40) {
  if (test.change == ChangeMode::Full) return walkPastWhatGoes(test, steps + steps / 4);
  std::mt19937_64 random(test.seed);
  struct Board {
    Eigen::Vector3d corner, along, up;
  };
  std::vector<Board> boards;
  for (int n = 0; n < 160; ++n) {
    const double heading = uniform(random, 0, 6.28), length = uniform(random, 0.1, 1.2);
    boards.push_back({{uniform(random, -20, 20), uniform(random, -3, 3), uniform(random, -1, 0.5)},
                      {length * std::cos(heading), length * std::sin(heading), 0},
                      {uniform(random, -0.1, 0.1), uniform(random, -0.1, 0.1), uniform(random, 0.2, 1.5)}});
  }
  std::vector<Step> walk;
  for (int s = 0; s < steps; ++s) {
    Step& step = walk.emplace_back();
    const double at = 2.0 * s / steps, x = at <= 1 ? 40 * at - 20 : 60 - 40 * at;
    const Eigen::Vector3d sensor_W(x, uniform(random, -1, 1), uniform(random, 0, 1));
    std::vector<Board> near;
    for (const Board& board : boards)
      if ((board.corner - sensor_W).norm() < 4) near.push_back(board);
    if (s % 11 == 7) near.clear();  // nothing in view
    for (int n = 0; n < 1500 && !near.empty(); ++n) {
      const Board& board = near[random() % near.size()];
      const Eigen::Vector3d noise(uniform(random, -0.02, 0.02), uniform(random, -0.02, 0.02),
                                  uniform(random, -0.02, 0.02));
      step.points_W.push_back(board.corner + uniform(random, 0, 1) * board.along + uniform(random, 0, 1) * board.up +
                              noise);
      if (test.ray_cloud) step.sensors_W.push_back(sensor_W + Eigen::Vector3d(1e-4 * n, 0, 0));
    }
    if (step.sensors_W.empty()) step.sensors_W.push_back(sensor_W);
  }
  return walk;
}

inline std::vector<ToolSpec> toolsOf(const Case& test) {
  std::vector<ToolSpec> tools;
  tools.push_back({armTool(), OrientationSet::yaw(), 0, "arm", 0});
  if (test.tools > 1) {
    tools.push_back(
        {boxTool({-0.03F, -0.2F, -0.05F}, {0.35F, 0.07F, 0.31F}), OrientationSet::sphere(30), 2, "hook", 0});
  }
  return tools;
}

inline FieldParams paramsOf(const Case& test) {
  FieldParams params = cpuParams(kVoxel_m);
  params.backend = backendNamedBy("ACCESSVDB_TILE_DEVICE");
  params.change.mode = test.change;
  params.change.free_for_s = test.free_for_s;
  params.scoring.point_spacing_m = test.spacing_m;
  return params;
}

inline void integrate(AccessibilityField& field, const Step& step, double stamp_s) {
  field.integrateRays(step.points_W, step.sensors_W, stamp_s);
}
inline void integrate(RollingField& field, const Step& step, double stamp_s) {
  field.integrateRays(step.points_W, step.sensors_W, stamp_s);
}

/// What is promised: the rest depends on when a point was looked at.
inline bool samePromise(const SurfacePoint& a, const SurfacePoint& b) {
  if (a.id != b.id || a.position_W != b.position_W || a.label != b.label || a.tools != b.tools) return false;
  if (!same(a.weight, b.weight)) return false;
  return a.label != PointLabel::Accessible ||
         (a.score == b.score && a.direction == b.direction && a.roll == b.roll && a.tool == b.tool);
}

inline std::size_t differences(const FieldSnapshot& a, const FieldSnapshot& b) {
  std::size_t count = std::max(a.points.size(), b.points.size()) - std::min(a.points.size(), b.points.size());
  for (std::size_t n = 0; n < std::min(a.points.size(), b.points.size()); ++n) {
    if (!samePromise(a.points[n], b.points[n])) ++count;
  }
  return count;
}

/// What all tiles take.
inline RollingStatus statusOfAll(const Case& test, const std::vector<Step>& steps) {
  const ScratchFolder scratch;
  RollingField all(toolsOf(test), paramsOf(test), {.folder = scratch / "tiles", .tile_voxels = kTile_voxels});
  for (std::size_t n = 0; n < steps.size(); ++n) integrate(all, steps[n], 0.1 * static_cast<double>(n));
  all.update();
  EXPECT_EQ(all.status().saved, 0U);
  return all.status();
}

/// On the host.
inline std::uint64_t bytesOfAll(const Case& test, const std::vector<Step>& steps) {
  return statusOfAll(test, steps).memory_bytes;
}

/// The most that all tiles take on a GPU, where they are scored as in the walk: some of it is there from then on.
inline std::uint64_t mostOnDevice(const Case& test, const std::vector<Step>& steps) {
  const ScratchFolder scratch;
  RollingField all(toolsOf(test), paramsOf(test), {.folder = scratch / "tiles", .tile_voxels = kTile_voxels});
  std::uint64_t most = 0;
  for (std::size_t n = 0; n < steps.size(); ++n) {
    integrate(all, steps[n], 0.1 * static_cast<double>(n));
    const bool last = n + 1 == steps.size();
    if (last || (test.update_every > 0 && n % static_cast<std::size_t>(test.update_every) == 0)) all.update();
    most = std::max(most, all.status().device_bytes);
  }
  return most;
}

/// Small tiles in a folder, with this share of what all of them take on the host. On a GPU a tile takes much however
/// little is in it, so that a step of few tiles may need most of it.
inline RollingOptions tightOptions(const Case& test, const std::vector<Step>& steps, double memory_share,
                                   std::filesystem::path folder) {
  const RollingStatus all = statusOfAll(test, steps);
  const double device_share = std::max(memory_share, 0.9);
  RollingOptions options;
  options.folder = std::move(folder);
  options.memory_limit_bytes = static_cast<std::uint64_t>(memory_share * static_cast<double>(all.memory_bytes));
  if (all.device_bytes > 0) {
    options.device_limit_bytes =
        static_cast<std::uint64_t>(device_share * static_cast<double>(mostOnDevice(test, steps)));
  }
  options.tile_voxels = kTile_voxels;
  return options;
}

/// Of a file X_Y.SERIAL.state.
inline std::string tileOf(const std::filesystem::path& file) {
  const std::string name = file.filename().string();
  return name.substr(0, name.find('.'));
}

/// The state of the westernmost tile in a folder.
inline std::filesystem::path westernmost(const std::filesystem::path& folder) {
  std::filesystem::path found;
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".state") continue;
    const std::int64_t x = tiles::TileId::parse(tileOf(entry.path())).x;
    if (x >= least) continue;
    least = x;
    found = entry.path();
  }
  return found;
}

}  // namespace accessvdb::test
