// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sample_scans/forest_scene.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "sample_scans/random_stream.h"

namespace accessvdb::samples {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kPathAmplitude_m = 1.5;
constexpr double kPathScale_m = 8.0;  // metres of x per radian
constexpr double kStripHalfWidth_m = 10.0;
constexpr double kMargin_m = 8.0;         // the scene extends beyond both ends of the path
constexpr double kPathClearance_m = 1.7;  // longest branch and thickest trunk stay off the sensor
constexpr double kTreeSpacing_m = 1.2;
constexpr double kLeafyShare = 0.7;
constexpr double kAreaPerTree_m2 = 7.0;
constexpr double kTwoPi = 2.0 * std::numbers::pi;

struct Placement {
  RandomStream random;
  double length_m;
  std::vector<Vector2d> taken = {};

  /// A free spot beside the path; if the strip is full, the last try is used.
  Vector2d spot() {
    Vector2d p(0, 0);
    for (int attempt = 0; attempt < 200; ++attempt) {
      const double x = random.uniform(-kMargin_m, length_m + kMargin_m);
      const double side = random.uniform(-kStripHalfWidth_m, kStripHalfWidth_m);
      // The slope of the path is below 0.19, so the distance across it shrinks by less than 2 %.
      const double sign = side < 0.0 ? -1.0 : 1.0;
      p = Vector2d(x, pathPoint(x).y() + sign * std::max(std::abs(side), kPathClearance_m));
      bool free = std::abs(side) >= kPathClearance_m;
      for (const Vector2d& other : taken) free = free && (other - p).norm() >= kTreeSpacing_m;
      if (free) break;
    }
    taken.push_back(p);
    return p;
  }
};

void addTree(const Vector2d& foot, RandomStream& random, std::vector<Shape>& shapes) {
  const double height = random.uniform(5.0, 10.0);
  const double base_radius = random.uniform(0.08, 0.20);
  shapes.push_back(TaperedCylinder{{foot.x(), foot.y(), 0.0}, height, base_radius, 0.3 * base_radius});
  for (double z = random.uniform(0.7, 1.2); z < 0.95 * height; z += random.uniform(0.35, 0.6)) {
    const int branches = 4 + static_cast<int>(random.next() % 3);
    const double first_yaw = random.uniform(0.0, kTwoPi);
    const double reach = random.uniform(0.6, 1.3) * (1.0 - 0.5 * z / height);
    for (int b = 0; b < branches; ++b) {
      const double yaw = first_yaw + kTwoPi * b / branches + random.uniform(-0.2, 0.2);
      const double climb = random.uniform(0.05, 0.55);
      const double length = reach * random.uniform(0.7, 1.0);
      const Vector3d from(foot.x(), foot.y(), z);
      const Vector3d along(std::cos(climb) * std::cos(yaw), std::cos(climb) * std::sin(yaw), std::sin(climb));
      shapes.push_back(Capsule{from, from + length * along, random.uniform(0.010, 0.025)});
      // Foliage at the outer end of most branches; a pruner works on the bare ones.
      if (random.uniform() < kLeafyShare) {
        shapes.push_back(Capsule{from + 0.7 * length * along, from + length * along, random.uniform(0.10, 0.28)});
      }
    }
  }
}

}  // namespace

Eigen::Vector2d pathPoint(double s_m) { return {s_m, kPathAmplitude_m * std::sin(s_m / kPathScale_m)}; }

double pathYaw(double s_m) { return std::atan(kPathAmplitude_m / kPathScale_m * std::cos(s_m / kPathScale_m)); }

AnalyticScene makeForest(const ForestOptions& options) {
  const double length = options.path_length_m;
  const double area = (length + 2.0 * kMargin_m) * 2.0 * kStripHalfWidth_m;
  const int trees = options.trees >= 0 ? options.trees : static_cast<int>(area / kAreaPerTree_m2);
  std::vector<Shape> shapes;

  // Separate streams, so that a different number of trees does not move the rest.
  Placement tree_spots{RandomStream(options.seed, 1), length};
  for (int i = 0; i < trees; ++i) {
    RandomStream random(options.seed, 1000 + static_cast<std::uint64_t>(i));
    addTree(tree_spots.spot(), random, shapes);
  }

  Placement box_spots{RandomStream(options.seed, 2), length};
  for (int i = 0; i < 3 + static_cast<int>(length / 10.0); ++i) {
    const Vector2d p = box_spots.spot();
    const Vector3d half(box_spots.random.uniform(0.15, 0.4), box_spots.random.uniform(0.15, 0.4),
                        box_spots.random.uniform(0.1, 0.5));
    shapes.push_back(Box{{p.x(), p.y(), half.z()}, half, box_spots.random.uniform(0.0, kTwoPi)});
  }

  const double wall_x = 0.5 * length;
  shapes.push_back(Box{{wall_x, pathPoint(wall_x).y() + 4.0, 1.1}, {2.0, 0.1, 1.1}, pathYaw(wall_x)});

  if (!options.flat_ground) {
    RandomStream random(options.seed, 3);
    for (int i = 0; i < static_cast<int>(area / 25.0); ++i) {
      const double x = random.uniform(-kMargin_m, length + kMargin_m);
      const double y = random.uniform(-kStripHalfWidth_m, kStripHalfWidth_m);
      const double height = random.uniform(0.04, 0.15);
      shapes.push_back(Bump{x, y, height, random.uniform(4.0, 8.0)});
    }
  }
  return AnalyticScene(std::move(shapes));
}

}  // namespace accessvdb::samples
