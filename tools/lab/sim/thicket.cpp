// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/thicket.h"

#include <Eigen/Geometry>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "sim/counter_random.h"
#include "sim/mesh_distance.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

constexpr std::uint64_t kThicketSeed = 20261129;
/// Radius of the ball that the parts are in.
constexpr double kSmallest_voxels = 40, kLargest_voxels = 80;
constexpr double kFacetError_voxels = 0.1;

/// Draws parts whose lengths are in voxels, one number after the other.
class PartDraw {
 public:
  PartDraw(std::uint64_t seed, double voxel_size_m) : random_({kThicketSeed, seed}), voxel_size_m_(voxel_size_m) {
    region_voxels_ = random_.uniform(kSmallest_voxels, kLargest_voxels);
  }

  /// How many of the smallest region this one has room for.
  [[nodiscard]] double room() const { return std::pow(region_voxels_ / kSmallest_voxels, 3); }

  int count(int low, int high) { return low + static_cast<int>(random_.uniform() * (high - low + 1)); }
  double uniform(double low, double high) { return random_.uniform(low, high); }
  double length_m(double low_voxels, double high_voxels) {
    return voxel_size_m_ * random_.uniform(low_voxels, high_voxels);
  }
  Eigen::Vector3d direction() {
    const double x = random_.gaussian(), y = random_.gaussian(), z = random_.gaussian();
    return Eigen::Vector3d(x, y, z).normalized();
  }
  Eigen::Vector3d place() {
    const double share = std::cbrt(random_.uniform());
    return region_voxels_ * voxel_size_m_ * share * direction();
  }
  RoundCone rod(double shortest, double longest, double thinnest, double thickest) {
    const Eigen::Vector3d middle_W = place();
    const Eigen::Vector3d half = 0.5 * length_m(shortest, longest) * direction();
    const double radius_m = length_m(thinnest, thickest);
    return {middle_W - half, middle_W + half, radius_m, radius_m * uniform(0.5, 1)};
  }

 private:
  CounterRandom random_;
  double voxel_size_m_, region_voxels_;
};

}  // namespace

Scene makeThicket(std::uint64_t seed, double voxel_size_m) {
  if (!(voxel_size_m > 0)) {
    throw InvalidArgument("sim.thicket", std::to_string(voxel_size_m), "the voxel size must be positive");
  }
  PartDraw draw(seed, voxel_size_m);
  Scene scene;
  const double error_m = kFacetError_voxels * voxel_size_m;
  const int wood = draw.count(4, 16);
  const int sticks = static_cast<int>(draw.room() * draw.count(60, 400)), needles_per_stick = draw.count(0, 40);
  for (int n = 0; n < wood; ++n) appendRoundCone(draw.rod(30, 90, 3, 8), error_m, scene.mesh);
  for (int n = 0; n < sticks; ++n) {
    const RoundCone stick = draw.rod(15, 50, 0.4, 2);
    appendRoundCone(stick, error_m, scene.mesh);
    for (int k = 0; k < needles_per_stick; ++k) {
      const Eigen::Vector3d root_W = stick.a_W + draw.uniform(0, 1) * (stick.b_W - stick.a_W);
      const Eigen::Vector3d tip_W = root_W + draw.length_m(4, 12) * draw.direction();
      appendNeedle({root_W, tip_W, draw.length_m(0.1, 0.3), 0}, scene.mesh);
    }
  }
  scene.name = "thicket_" + std::to_string(seed);
  char text[160];
  std::snprintf(text, sizeof text, "%d pieces of wood, %d sticks with %d needles each, of voxels of %g mm, seed %llu",
                wood, sticks, needles_per_stick, 1000 * voxel_size_m, static_cast<unsigned long long>(seed));
  scene.description = text;
  std::string why_not;
  scene.distance = makeMeshDistance(scene.mesh, why_not);
  if (!scene.distance) throw InternalError("simulation.thicket", scene.name, why_not);
  scene.distance_note = "exact distance to the triangles that rays hit";
  return scene;
}

}  // namespace accessvdb::sim
