// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/unseen_scene.h"

#include <cmath>
#include <numbers>
#include <utility>

#include "accessvdb/error.h"
#include "sim/counter_random.h"

namespace accessvdb::sim {
namespace {

/// Never change this or the ranges below: drawing again until the figures look good would be tuning.
constexpr std::uint64_t kSeed = 20260101;

/// Lengths in whole millimetres and integer counts, so that a description is exact.
class SceneDraw {
 public:
  explicit SceneDraw(int number) : random_({kSeed, static_cast<std::uint64_t>(number)}) {}
  double length_m(double low_m, double high_m) { return std::round(random_.uniform(low_m, high_m) * 1000) / 1000; }
  int count(int low, int high) { return low + static_cast<int>(random_.uniform() * (high - low + 1)); }
  double uniform(double low, double high) { return random_.uniform(low, high); }

 private:
  CounterRandom random_;
};

Scene drawTorus(SceneDraw& draw) {
  const double major_m = draw.length_m(0.045, 0.10);
  return makeTorus(major_m, std::round(major_m * draw.uniform(0.18, 0.56) * 1000) / 1000);
}

Scene drawBox(SceneDraw& draw) {
  const double x_m = draw.length_m(0.2, 0.5), y_m = draw.length_m(0.2, 0.5), z_m = draw.length_m(0.2, 0.4);
  return makeBox({x_m, y_m, z_m});
}

}  // namespace

std::optional<int> unseenNumber(const std::string& name) {
  for (int number = 1; number <= kUnseenScenes; ++number) {
    if (name == "unseen_" + std::to_string(number)) return number;
  }
  return std::nullopt;
}

BenchmarkScene unseenScene(int number) {
  if (number < 1 || number > kUnseenScenes) {
    throw InvalidArgument("sim.scene", "unseen_" + std::to_string(number), "is not a scene of the tables",
                          "Use unseen_1 to unseen_" + std::to_string(kUnseenScenes));
  }
  SceneDraw draw(number);
  BenchmarkScene out;
  double height_m = 0;
  if (number <= 3) {
    out.scene = drawTorus(draw);
    out.path.radius_m = draw.length_m(0.4, 0.9);
    height_m = draw.length_m(0.15, 0.45);
    out.frames = draw.count(750, 1000);
  } else if (number <= 5) {
    out.scene = drawBox(draw);
    // At 0.4 m beyond the farthest edge: closer, the sensor's view does not cover the height of a face.
    const Eigen::Vector3d half = out.scene.mesh.vertices_W.back().cwiseAbs().cast<double>();
    out.path.radius_m = std::round(std::hypot(half.x(), half.y()) * 1000) / 1000 + draw.length_m(0.4, 0.7);
    height_m = draw.length_m(0, 0.1);
    out.frames = draw.count(150, 300);
  } else {
    out.scene = makeSphere(draw.length_m(0.05, 0.10));
    out.path.radius_m = draw.length_m(0.4, 0.8);
    height_m = draw.length_m(0.2, 0.35);
    out.frames = draw.count(750, 1000);
  }
  out.path.height_begin_m = -height_m;
  out.path.height_end_m = height_m;
  out.path.azimuth_begin_rad = draw.uniform(0, 2 * std::numbers::pi);
  out.path.azimuth_end_rad = out.path.azimuth_begin_rad + 2 * std::numbers::pi * draw.count(5, 9);
  // Less than the coarsest voxel of the tables on each axis: the grid's phase, at every voxel size.
  Eigen::Vector3d offset_W;
  for (double& phase_m : offset_W)
    phase_m = draw.uniform(0, 0.005);  // one after the other: argument evaluation has no order
  out.scene = translated(std::move(out.scene), offset_W);
  return out;
}

}  // namespace accessvdb::sim
