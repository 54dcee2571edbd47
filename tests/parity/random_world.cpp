// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "parity/random_world.h"

#include <array>
#include <cmath>

#include "support/box_tool.h"

namespace accessvdb::test {

ToolGeometry boxTool(Random& random, double voxel_size_m) {
  const auto v = static_cast<float>(voxel_size_m);
  const auto size = [&](double low, double high) { return static_cast<float>(random.uniform(low, high)) * v; };
  const Eigen::Vector3f low(size(-1, 4), -size(0.5, 3), -size(0.5, 4)),
      high(low.x() + size(4, 14), size(0.5, 3), size(0.5, 9));
  return boxTool(low, high);
}

std::vector<RayScan> randomScans(Random& random, double v) {
  const Eigen::Vector3d centre(random.uniform(-40, 40) * v, random.uniform(-40, 40) * v, random.uniform(-40, 40) * v);
  const bool wall = random.below(2) == 0;
  const double yaw = random.uniform(0, 6.3), lean = random.uniform(-0.7, 0.7);
  const Eigen::Vector3d normal(std::cos(yaw), std::sin(yaw), lean), along(-std::sin(yaw), std::cos(yaw), 0);
  const double half = random.uniform(5, 10) * v;
  std::vector<RayScan> scans;
  for (int scan = 0; scan < 5; ++scan) {
    RayScan& rays = scans.emplace_back();
    const double sensor_yaw = yaw + random.uniform(-1.5, 1.5);
    const double range = random.uniform(30, 80) * v;
    const Eigen::Vector3d sensor =
        centre + range * Eigen::Vector3d(std::cos(sensor_yaw), std::sin(sensor_yaw), random.uniform(-0.5, 0.5));
    for (int n = 0; n < 90; ++n) {
      Eigen::Vector3d p = centre;
      if (wall && random.below(8) != 0) {
        const double u = random.uniform(-half, half), w = random.uniform(-half, half);
        p += u * along + w * Eigen::Vector3d(0, 0, 1) - w * lean * Eigen::Vector3d(std::cos(yaw), std::sin(yaw), 0) +
             random.uniform(-0.5, 0.5) * v * normal;
      } else {
        p += Eigen::Vector3d(random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half));
      }
      rays.points_W.push_back(p);
      rays.origins_W.push_back(sensor + Eigen::Vector3d(random.uniform(-v, v), random.uniform(-v, v), 0));
    }
  }
  return scans;
}

FieldParams randomParams(Random& random) {
  constexpr std::array<double, 6> kVoxels = {0.02, 0.025, 0.0375, 0.05, 0.0625, 0.1};
  constexpr std::array<int, 6> kDirections = {4, 17, 36, 90, 180, 256};
  FieldParams params;
  params.tsdf.voxel_size_m = kVoxels[static_cast<std::size_t>(random.below(6))];
  params.tsdf.range_noise_m = random.below(3) * 0.5 * params.tsdf.voxel_size_m;
  params.approach.num_directions = kDirections[static_cast<std::size_t>(random.below(6))];
  if (random.below(4) == 0) params.approach.normal_cone_rad = random.uniform(0.2, 1.5);
  if (random.below(3) == 0) params.approach.corridor_length_m = random.uniform(8, 30) * params.tsdf.voxel_size_m;
  if (random.below(2) == 0) params.scoring.max_collisions = 1 + random.below(20);
  if (random.below(4) == 0) params.scoring.self_exclusion_voxels = random.uniform(0, 5);
  params.scoring.join_neighbour_views = random.below(4) != 0;
  params.scoring.mean_positions = random.below(4) != 0;
  params.scoring.neighbourhood_weight = random.below(4) != 0;
  return params;
}

void chooseOrientations(Random& random, ApproachParams& approach) {
  if (random.below(3) == 0) approach.rolls = 1 + random.below(9);  // else by rule, which lets tools roll over spheres
  constexpr std::array<double, 4> kSteps = {12.5, 15, 30, 45};
  approach.num_directions = 36;
  switch (random.below(4)) {
    case 0:
      approach.orientations = OrientationSet::sphere(kSteps[static_cast<std::size_t>(random.below(4))]);
      break;
    case 1:
      approach.orientations = OrientationSet::pitch(-30, 30, 10);
      break;
    case 2:
      approach.num_directions = 17;
      approach.orientations = OrientationSet::pitch(-90, 90, 22.5);
      break;
    default: {
      std::vector<ToolOrientation> list;
      for (int n = 1 + random.below(256); n > 0; --n) {
        list.push_back(orientationOf(random.uniform(-360, 360), random.below(9) == 0 ? 0 : random.uniform(-90, 90),
                                     random.uniform(-180, 180)));
      }
      approach.orientations = OrientationSet::of(std::move(list));
      break;
    }
  }
}

ToolGeometry randomTool(Random& random, double v) {
  const int kind = random.below(4);
  if (kind == 0) return ToolGeometry::builtin("builtin:pencil");
  if (kind == 1 && v >= 0.05) return ToolGeometry::builtin("builtin:pruner");
  return boxTool(random, v);
}

}  // namespace accessvdb::test
