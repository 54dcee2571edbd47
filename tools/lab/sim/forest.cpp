// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/forest.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdio>
#include <functional>

#include "accessvdb/error.h"
#include "sim/angles.h"
#include "sim/counter_random.h"
#include "sim/pine.h"
#include "sim/understory.h"

namespace accessvdb::sim {
namespace {

constexpr double kRow_m = 6.0, kInRow_m = 3.2, kJitter_m = 0.4;  // trees in rows at y = +-3, +-9, ...
constexpr double kPatch_m = 2.6;                                 // undergrowth on a grid
constexpr double kBareShare = 0.3;                               // of that grid
/// Heights such that crowns leave the lane free: a tree's longest branch is 0.23 of its height (sim/pine_skeleton.cpp).
constexpr double kTreeHeights_m[] = {9.0, 10.0, 11.0, 8.5};
constexpr int kUndergrowthKinds = 4;
constexpr double kFlightHeight_m = 2.2;  // above the mean ground; undergrowth reaches 1.4 at most
constexpr double kNoseDown_rad = 10 * kDegree;

// The clearing: crowns outside and inside leave more than half a metre to the path, and undergrowth does not reach it.
constexpr double kClearing_m = kOrbitRadius_m + 0.23 * 11 + 0.8;  // no trunk up to here, except the group's
constexpr int kGroupTrees = 3;
constexpr double kGroupRadius_m = 1.2;
constexpr double kBareRing_m = 1.8;  // half its width; undergrowth reaches 1.5 m from the middle of its patch
constexpr double kOrbitLow_m = 1.5, kOrbitHigh_m = 6, kLapsPerSweep = 3;
constexpr double kLookAt_m = 0.5 * (kOrbitLow_m + kOrbitHigh_m);  // height of the place that stays in the middle
constexpr double kMiddleOfView_rad = 22.5 * kDegree;              // of a Mid-360

enum Stream : std::uint64_t { kTreeStream = 1, kPatchStream = 2, kGroupStream = 3 };

/// The pines in the middle of the clearing, around the origin.
std::vector<PlacedMesh> pineGroup(std::uint64_t seed, std::size_t kinds) {
  std::vector<PlacedMesh> group;
  for (int n = 0; n < kGroupTrees; ++n) {
    CounterRandom random({seed, kGroupStream, static_cast<std::uint64_t>(n)});
    PlacedMesh tree;
    tree.mesh = static_cast<std::uint32_t>(random.uniform() * static_cast<double>(kinds));
    tree.yaw_rad = random.uniform(0, kTurn);
    const double azimuth_rad = kTurn * n / kGroupTrees + random.uniform(-0.3, 0.3);
    const double x_m = kGroupRadius_m * std::cos(azimuth_rad), y_m = kGroupRadius_m * std::sin(azimuth_rad);
    tree.offset_W = {x_m, y_m, groundHeight_m(x_m, y_m) - 0.05};
    group.push_back(tree);
  }
  return group;
}

/// @throws InvalidArgument  @return length of the path from one frame to the next
double requireStep(double speed_m_s, double frame_period_s) {
  const double step_m = speed_m_s * frame_period_s;
  if (!(step_m > 0) || !(frame_period_s > 0) || !std::isfinite(step_m)) {
    throw InvalidArgument("sim.forest", "flight", "its speed or frame period is not positive", "Use for example 1 m/s");
  }
  return step_m;
}

}  // namespace

Forest makeForest(const ForestParams& params) {
  if (!(params.path_length_m > 0 && params.path_length_m <= 10'000)) {
    throw InvalidArgument("sim.forest", "path length", "must be above 0 and at most 10 km", "Use fewer frames");
  }
  if (!(params.view_m >= 1 && params.view_m <= 200)) {
    throw InvalidArgument("sim.forest", "--max-range", "must be in 1 .. 200 m in a forest", "Use for example 30");
  }
  Forest forest;
  constexpr std::size_t kPines = std::size(kTreeHeights_m), kMeshes = kPines + kUndergrowthKinds + 1;
  forest.meshes.resize(kMeshes);
  tbb::parallel_for(std::size_t{0}, kMeshes, [&](std::size_t n) {
    forest.meshes[n] = n < kPines ? makePineMesh({kTreeHeights_m[n], mixBits(params.seed) + n}, params.solid_foliage_m)
                       : n + 1 < kMeshes ? makeUndergrowth(mixBits(params.seed) + n)
                                         : makeGroundTile();
  });

  const double begin_m = -params.view_m, end_m = params.path_length_m + params.view_m;
  const auto rows = static_cast<int>(std::ceil(params.view_m / kRow_m));
  const auto count = [&](double step_m) { return static_cast<int>(std::ceil((end_m - begin_m) / step_m)); };
  for (int row = -rows; row < rows; ++row) {
    for (int n = 0; n < count(kInRow_m); ++n) {
      CounterRandom random(
          {params.seed, kTreeStream, static_cast<std::uint64_t>(row + rows), static_cast<std::uint64_t>(n)});
      PlacedMesh tree;
      tree.mesh = static_cast<std::uint32_t>(random.uniform() * kPines);
      tree.yaw_rad = random.uniform(0, kTurn);
      const double x_m = begin_m + kInRow_m * n + random.uniform(-kJitter_m, kJitter_m);
      const double y_m = kRow_m * (row + 0.5) + random.uniform(-kJitter_m, kJitter_m);
      tree.offset_W = {x_m, y_m, groundHeight_m(x_m, y_m) - 0.05};  // rooted, not floating over a slope
      if (params.clearing && std::hypot(x_m, y_m) < kClearing_m) continue;
      forest.placed.push_back(tree);
    }
  }
  if (params.clearing) {
    const std::vector<PlacedMesh> group = pineGroup(params.seed, kPines);
    forest.placed.insert(forest.placed.end(), group.begin(), group.end());
  }
  forest.trees = forest.placed.size();

  const auto patches = static_cast<int>(std::ceil(params.view_m / kPatch_m));
  for (int row = -patches; row <= patches; ++row) {
    for (int n = 0; n < count(kPatch_m); ++n) {
      CounterRandom random(
          {params.seed, kPatchStream, static_cast<std::uint64_t>(row + patches), static_cast<std::uint64_t>(n)});
      if (random.uniform() < kBareShare) continue;
      PlacedMesh patch;
      patch.mesh = static_cast<std::uint32_t>(kPines + std::size_t(random.uniform() * kUndergrowthKinds));
      patch.yaw_rad = random.uniform(0, kTurn);
      const double x_m = begin_m + kPatch_m * n, y_m = kPatch_m * row;
      if (params.clearing && std::abs(std::hypot(x_m, y_m) - kOrbitRadius_m) < kBareRing_m) continue;
      patch.offset_W = {x_m, y_m, groundHeight_m(x_m, y_m)};
      forest.placed.push_back(patch);
    }
  }

  const auto tile = [](double at_m) { return static_cast<int>(std::floor(at_m / kGroundPeriod_m)); };
  for (int i = tile(begin_m); i <= tile(end_m); ++i) {
    for (int j = tile(-params.view_m); j <= tile(params.view_m); ++j) {
      forest.placed.push_back({kMeshes - 1, 0, {kGroundPeriod_m * i, kGroundPeriod_m * j, 0}});
    }
  }

  std::size_t triangles = 0;
  for (const PlacedMesh& each : forest.placed) triangles += forest.meshes[each.mesh].triangles.size();
  char text[300];
  std::snprintf(text, sizeof text,
                "planted forest: %zu pines of %zu kinds, 8.5 to 11 m high, in rows 6 m apart and 3.2 m in the row, "
                "undergrowth, uneven ground%s; %.3g million triangles placed, seed %llu",
                forest.trees, kPines, params.clearing ? ", three of them in the middle of a clearing" : "",
                static_cast<double>(triangles) * 1e-6, static_cast<unsigned long long>(params.seed));
  forest.description = text;
  return forest;
}

Trajectory forestFlight(double speed_m_s, double frame_period_s, int frames) {
  const double step_m = requireStep(speed_m_s, frame_period_s);
  // A straight walk checks the number of frames; a frame's position depends only on its number, so that a longer flight
  // begins with the shorter one.
  Trajectory path = walk({0, 0, 0}, {1, 0, 0}, kNoseDown_rad, frames);
  for (std::size_t n = 0; n < path.size(); ++n) {
    const double t_s = static_cast<double>(n) * frame_period_s;
    path[n].translation() = Eigen::Vector3d(step_m * static_cast<double>(n), 0, kFlightHeight_m);
    path[n].translation() += Eigen::Vector3d(0, 0.25 * std::sin(0.31 * t_s), 0.12 * std::sin(0.47 * t_s + 1));
    path[n].linear() = (Eigen::AngleAxisd(12 * kDegree * std::sin(0.23 * t_s), Eigen::Vector3d::UnitZ()) *
                        Eigen::AngleAxisd(3 * kDegree * std::sin(1.7 * t_s), Eigen::Vector3d::UnitY()) *
                        Eigen::AngleAxisd(3 * kDegree * std::sin(1.3 * t_s + 2), Eigen::Vector3d::UnitX()))
                           .toRotationMatrix() *
                       path[n].linear();
  }
  return path;
}

Trajectory forestOrbit(double speed_m_s, double frame_period_s, int frames) {
  const double step_m = requireStep(speed_m_s, frame_period_s);
  Trajectory path = walk({0, 0, 0}, {1, 0, 0}, 0, frames);  // checks the number of frames
  for (std::size_t n = 0; n < path.size(); ++n) {
    const double t_s = static_cast<double>(n) * frame_period_s;
    const double azimuth_rad = step_m * static_cast<double>(n) / kOrbitRadius_m;
    const double radius_m = kOrbitRadius_m + 0.2 * std::sin(0.31 * t_s);
    const double sweep_rad = azimuth_rad / kLapsPerSweep;
    const double height_m = kLookAt_m - 0.5 * (kOrbitHigh_m - kOrbitLow_m) * std::cos(sweep_rad);
    path[n].translation() =
        Eigen::Vector3d(radius_m * std::cos(azimuth_rad), radius_m * std::sin(azimuth_rad), height_m);
    // Pitched so that the middle of the group is in the middle of the view.
    const double nose_down_rad = std::atan2(height_m - kLookAt_m, radius_m) + kMiddleOfView_rad;
    path[n].linear() = (Eigen::AngleAxisd(azimuth_rad + 0.5 * kTurn, Eigen::Vector3d::UnitZ()) *
                        Eigen::AngleAxisd(nose_down_rad + 3 * kDegree * std::sin(1.7 * t_s), Eigen::Vector3d::UnitY()) *
                        Eigen::AngleAxisd(3 * kDegree * std::sin(1.3 * t_s + 2), Eigen::Vector3d::UnitX()))
                           .toRotationMatrix();
  }
  return path;
}

}  // namespace accessvdb::sim
