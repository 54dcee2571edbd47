// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One scene for each reach of src/field/tools/window_margins.h: a tile's point whose label depends on a single thing
/// outside of the tile, moved outwards voxel by voxel. The tile has to equal one piece at every distance, also at the
/// farthest that matters, which follows from the method and is not read from the library.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "support/box_tool.h"
#include "support/determinism_support.h"

namespace accessvdb::test {
namespace {

constexpr int kTileVoxels = 128;
/// Enough rays for every point to be scored.
constexpr int kTimes = 6;

struct Rays {
  std::vector<Eigen::Vector3d> points_W, sensors_W;
  void add(const Eigen::Vector3d& p_W, const Eigen::Vector3d& sensor_W) {
    points_W.push_back(p_W);
    sensors_W.push_back(sensor_W);
  }
  void add(const Rays& more) {
    points_W.insert(points_W.end(), more.points_W.begin(), more.points_W.end());
    sensors_W.insert(sensors_W.end(), more.sensors_W.begin(), more.sensors_W.end());
  }
};

/// What lies in the tile and its last column of voxels, x = 127.
struct Scene {
  ToolGeometry tool;
  FieldParams params;
  Rays inside;
  std::vector<Rays> later = {};  ///< scans after the first

  /// The middle of a voxel that lies `outside` voxels beyond the tile's last one.
  [[nodiscard]] double x_m(int outside) const { return (kTileVoxels - 1 + outside) * params.tsdf.voxel_size_m; }
  [[nodiscard]] double y_m() const { return 64 * params.tsdf.voxel_size_m; }
  [[nodiscard]] double end_m() const { return (kTileVoxels - 0.5) * params.tsdf.voxel_size_m; }
};

/// The directions along x only, and bands that are not longer than tau.
FieldParams paramsOf(double voxel_size_m, double tau_m) {
  FieldParams params;
  params.backend = BackendKind::Cpu;
  params.threads = 1;
  params.origin_W = {{0, 0, 0}};
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.truncation_distance_m = tau_m;
  params.tsdf.range_noise_m = 0;
  params.approach.num_directions = 4;
  params.approach.normal_cone_rad = 0.2;
  return params;
}

/// A square of 9 x 9 points in x = x_m, seen from far outside along x.
Rays plate(const Scene& scene, int outside, double edge_m) {
  Rays rays;
  for (int n = 0; n < 81 * kTimes; ++n) {
    const double y_m = scene.y_m() + edge_m * (n % 9 - 4) / 8.0, z_m = edge_m * (n / 9 % 9 - 4) / 8.0;
    rays.add({scene.x_m(outside), y_m, z_m}, {scene.x_m(outside) + 10, y_m, z_m});
  }
  return rays;
}

std::vector<SurfacePoint> pointsInside(const Scene& scene, const Rays& outside, bool tile) {
  FieldParams params = scene.params;
  if (tile) params.window = FieldWindow{{0, 0}, {kTileVoxels, kTileVoxels}};
  AccessibilityField field(scene.tool, params);
  Rays rays = scene.inside;
  rays.add(outside);
  field.integrateRays(rays.points_W, rays.sensors_W);
  for (const Rays& scan : scene.later) field.integrateRays(scan.points_W, scan.sensors_W);
  field.update();
  std::vector<SurfacePoint> points;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.position_W.x() < scene.end_m()) points.push_back(point);
  }
  return points;
}

bool same(const std::vector<SurfacePoint>& a, const std::vector<SurfacePoint>& b) {
  if (a.size() != b.size()) return false;
  for (std::size_t n = 0; n < a.size(); ++n) {
    if (a[n].position_W != b[n].position_W || !sameVerdict(a[n], b[n])) return false;
  }
  return true;
}

/// The farthest of the distances, in voxels, at which something outside changes a point inside. The tile equals one
/// piece at each of them.
template <class Outside>
int farthestThatMatters(const Scene& scene, int from, int to, const Outside& outside) {
  const std::vector<SurfacePoint> alone = pointsInside(scene, {}, false);
  EXPECT_FALSE(alone.empty());
  int farthest = 0;
  for (int distance = from; distance <= to; ++distance) {
    const std::vector<SurfacePoint> one = pointsInside(scene, outside(distance), false);
    EXPECT_TRUE(same(pointsInside(scene, outside(distance), true), one)) << distance << " voxels outside";
    if (!same(one, alone)) farthest = distance;
  }
  EXPECT_LT(farthest, to) << "the distances end too soon";
  return farthest;
}

/// Behind a return, voxels collide as far as tau. An obstacle that faces away touches the tool's far end with those.
TEST(TileReach, OfAnObstacleAtTheFarEndOfTheTool) {
  const double v = 0.05;
  const int tool_voxels = 24, tau_voxels = 4;
  Scene scene{boxTool({-0.02f, -0.04f, -0.04f}, {static_cast<float>(tool_voxels * v), 0.04f, 0.04f}),
              paramsOf(v, tau_voxels * v),
              {}};
  scene.params.tsdf.cleared_end_tau = 0.7;
  scene.params.tsdf.cleared_radius_voxels = 0.5;
  scene.params.approach.arm_tau = {0.5, 0.55, 0.6};
  scene.inside = plate(scene, 0, 0.3);
  const int farthest = farthestThatMatters(scene, tool_voxels - 2, tool_voxels + tau_voxels + 4,
                                           [&](int distance) { return plate(scene, distance, 0.2); });
  EXPECT_GE(farthest, tool_voxels + tau_voxels - 1);
}

/// A voxel is free for the arm if a ray cleared it, as far before the ray's return as the corridor is long.
TEST(TileReach, OfAReturnThatClearsTheEndOfTheCorridor) {
  const double v = 0.05, tau_m = 0.2;
  const int corridor_voxels = 31;
  Scene scene{boxTool({-0.02f, -0.04f, -0.04f}, {0.3f, 0.04f, 0.04f}), paramsOf(v, tau_m), {}};
  scene.params.approach.corridor_length_m = corridor_voxels * v;
  // Rays to the point's own plate come at a slant, so they do not clear its corridor.
  for (const Eigen::Vector3d& p_W : plate(scene, 0, 0.3).points_W) {
    scene.inside.add(p_W, p_W + Eigen::Vector3d(10, 10, 0));
  }
  // A ceiling, seen from below, clears the corridor but for its end.
  const int columns = corridor_voxels - 3;
  for (int n = 0; n < columns * 9 * kTimes; ++n) {
    const double x_m = scene.x_m(n % columns), y_m = scene.y_m() + v * (n / columns % 9 - 4);
    scene.inside.add({x_m, y_m, 1.6 * tau_m}, {x_m, y_m, -10});
  }
  const int farthest = farthestThatMatters(scene, 2 * corridor_voxels - 5, 2 * corridor_voxels + 4, [&](int d) {
    Rays wall;
    for (const Eigen::Vector3d& p_W : plate(scene, d, 0.4).points_W) wall.add(p_W, {-10, p_W.y(), p_W.z()});
    return wall;
  });
  EXPECT_GE(farthest, 2 * corridor_voxels - 1);
}

/// Whether a return is news depends on what the map holds in its voxel, and that on returns within tau of it: votes
/// reach twice as far as samples. A thing appears within tau of the tool's far end, in space that only a wall behind it
/// had shown to be free.
TEST(TileReach, OfAWallBeforeWhichSomethingNewAppears) {
  const double v = 0.05;
  const int tool_voxels = 24, tau_voxels = 4;
  Scene scene{boxTool({-0.02f, -0.04f, -0.04f}, {static_cast<float>(tool_voxels * v), 0.04f, 0.04f}),
              paramsOf(v, tau_voxels * v),
              {}};
  scene.params.tsdf.cleared_end_tau = 0.7;
  scene.params.tsdf.cleared_radius_voxels = 0.5;
  scene.params.approach.arm_tau = {0.5, 0.55, 0.6};
  scene.inside = plate(scene, 0, 0.3);
  // A ceiling over the tool's far end, seen from below, shows that there is nothing yet.
  for (int n = 0; n < 5 * 5 * kTimes; ++n) {
    const double x_m = scene.x_m(tool_voxels - n % 5), y_m = scene.y_m() + v * (n / 5 % 5 - 2);
    scene.inside.add({x_m, y_m, 3 * v}, {x_m, y_m, -10});
  }
  // The new thing faces away from the tile: behind it, voxels collide as far as tau.
  Rays thing;
  for (int n = 0; n < 25; ++n) {
    const double x_m = scene.x_m(tool_voxels + tau_voxels - 1), y_m = scene.y_m() + v * (n % 5 - 2),
                 z_m = v * (n / 5 - 2);
    thing.add({x_m, y_m, z_m}, {x_m + 10, y_m, z_m});
  }
  scene.later = {thing, thing, thing};
  const int farthest =
      farthestThatMatters(scene, tool_voxels + tau_voxels, tool_voxels + 2 * tau_voxels + 4, [&](int d) {
        Rays wall;
        for (const Eigen::Vector3d& p_W : plate(scene, d, 0.4).points_W) {
          for (int times = 0; times < 10; ++times) wall.add(p_W, {-10, p_W.y(), p_W.z()});
        }
        return wall;
      });
  EXPECT_GE(farthest, tool_voxels + 2 * tau_voxels - 1);
}

/// In voxels below 10 mm, normals look farther than a short tool.
TEST(TileReach, OfTheFarthestNeighbour) {
  const double v = 0.005;
  const int radius_voxels = 20;  // 0.1 m
  Scene scene{boxTool({-0.004f, -0.004f, -0.004f}, {0.03f, 0.004f, 0.004f}), paramsOf(v, 2 * v), {}};
  scene.params.tsdf.cleared_end_tau = 1;
  scene.params.tsdf.cleared_radius_voxels = 0.5;
  scene.params.approach.arm_tau = {0.3, 0.6, 0.9};
  // Fewer points than a normal may have, so that those outside are among them.
  for (int n = 0; n < 4 * kTimes; ++n) {
    const double y_m = scene.y_m() + 3 * v * (n % 2), z_m = 3 * v * (n / 2 % 2);
    scene.inside.add({scene.x_m(0), y_m, z_m}, {10, y_m, z_m});
  }
  const int farthest = farthestThatMatters(scene, radius_voxels - 6, radius_voxels + 4, [&](int distance) {
    Rays rays;
    for (int n = 0; n < kTimes; ++n) {
      rays.add({scene.x_m(distance), scene.y_m(), 0}, {10, scene.y_m(), 0});
    }
    return rays;
  });
  EXPECT_GE(farthest, radius_voxels - 1);
}

}  // namespace
}  // namespace accessvdb::test
