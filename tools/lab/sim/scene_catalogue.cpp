// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/scene_catalogue.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "accessvdb/error.h"
#include "sim/angles.h"
#include "sim/tilt_scenes.h"
#include "sim/unseen_scene.h"

namespace accessvdb::sim {
namespace {

/// The object in the middle of [-height, height] and of [begin, end].
Helix around(double radius_m, double height_m, double azimuth_begin_rad, double azimuth_end_rad) {
  Helix shape;
  shape.radius_m = radius_m;
  shape.height_begin_m = -height_m;
  shape.height_end_m = height_m;
  shape.azimuth_begin_rad = azimuth_begin_rad;
  shape.azimuth_end_rad = azimuth_end_rad;
  return shape;
}

/// Only one side of the object: back and forth as often as the torus is circled (docs/PAPER.md, "Scenes").
Helix beside(double radius_m, double height_m, double azimuth_rad) {
  Helix shape = around(radius_m, height_m, -azimuth_rad, azimuth_rad);
  shape.sweeps = 7;
  return shape;
}

/// The torus' view and major radius, so that the thinness of the tube is the only difference.
BenchmarkScene ring(double voxel_size_m) {
  if (!(voxel_size_m > 0) || !(1.5 * voxel_size_m < 0.06)) {
    throw InvalidArgument("sim.ring", "--voxel",
                          "the ring's tube has a radius of 1.5 voxels and its major radius is 0.06 m",
                          "Choose a voxel size between 0 and 0.04 m");
  }
  return {makeTorus(0.06, 1.5 * voxel_size_m), around(0.5, 0.4, 0, 7 * kTurn), 1000, {}};
}

BenchmarkScene make(const std::string& name, double voxel_size_m) {
  if (name == "torus") return {makeTorus(0.06, 0.02), around(0.5, 0.4, 0, 7 * kTurn), 1000, {}};
  if (name == "sphere_a") return {makeSphere(0.08), around(0.6, 0.3, 0, 7 * kTurn), 750, {}};
  if (name == "sphere_b") return {makeSphere(0.10), beside(0.8, 0.35, 42 * kDegree), 1000, {}};
  if (name == "box") return {makeBox({0.4, 0.4, 0.4}), around(0.5, 0.05, 0, kTurn), 75, {}};
  if (name == "wall") return {makeBox({0.02, 0.28, 0.28}, "wall"), beside(0.6, 0.14, 35 * kDegree), 110, {}};
  if (name == "ring") return ring(voxel_size_m);
  if (const auto number = unseenNumber(name)) return unseenScene(*number);
  if (auto tilted = tiltScene(name)) return std::move(*tilted);
  std::string known;
  for (const std::string& each : benchmarkSceneNames()) known += (known.empty() ? "" : ", ") + each;
  throw InvalidArgument("sim.scene", name, "is not a scene of the tables", "Use one of " + known);
}

}  // namespace

BenchmarkScene benchmarkScene(const std::string& name, double voxel_size_m, int frames) {
  BenchmarkScene out = make(name, voxel_size_m);
  out.scene.name = name;
  if (frames != 0) out.frames = frames;
  out.path.centre_W = out.scene.centre_W;
  out.trajectory = helix(out.path, out.frames);
  return out;
}

std::vector<std::string> benchmarkSceneNames() {
  std::vector<std::string> names = {"torus", "sphere_a", "sphere_b", "box", "wall", "ring"};
  for (int number = 1; number <= kUnseenScenes; ++number) names.push_back("unseen_" + std::to_string(number));
  for (const std::string& name : tiltSceneNames()) names.push_back(name);
  return names;
}

}  // namespace accessvdb::sim
