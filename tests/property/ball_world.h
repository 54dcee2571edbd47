// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A ball of known place and size as the scene, for what is compared with exact distances.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/tool_spec.h"

namespace accessvdb::test::ball_world {

constexpr double kVoxel_m = 0.02, kRadius_m = 0.5;
inline const Eigen::Vector3d kCentre_W(0, 0, 2);

struct Random {
  double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(engine); }
  Eigen::Vector3d direction() {
    const std::normal_distribution<double> normal;
    std::normal_distribution<double> each = normal;
    return Eigen::Vector3d(each(engine), each(engine), each(engine)).normalized();
  }
  Eigen::Isometry3d pose(double near_m, double far_m) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = kCentre_W + uniform(near_m, far_m) * direction();
    T.linear() = Eigen::AngleAxisd(uniform(0, M_PI), direction()).toRotationMatrix();
    return T;
  }
  std::mt19937 engine{5};
};

/// A ball, seen from all sides, and all that rays went through.
inline AccessibilityField ballField(const std::vector<ToolSpec>& tools, FieldParams params = {}) {
  params.tsdf.voxel_size_m = kVoxel_m;
  params.tsdf.range_noise_m = 0;
  params.tsdf.clear_rays_m = std::numeric_limits<double>::infinity();
  params.backend = BackendKind::Cpu;
  AccessibilityField field(tools, params);
  Random random;
  for (int n = 0; n < 40; ++n) {
    std::vector<Eigen::Vector3d> points_W, origins_W;
    for (int k = 0; k < 4000; ++k) {
      const Eigen::Vector3d normal = random.direction();
      points_W.push_back(kCentre_W + kRadius_m * normal);
      origins_W.emplace_back(points_W.back() + 2 * (normal + 0.3 * random.direction()));
    }
    field.integrateRays(points_W, origins_W);
  }
  return field;
}

inline AccessibilityField ballField(const ToolGeometry& tool) { return ballField(onlyTool(tool, {})); }

/// Places on the tool's surface, at most so far apart.
inline std::vector<Eigen::Vector3d> surfaceOf(const ToolGeometry& tool, double spacing_m) {
  std::vector<Eigen::Vector3d> places;
  for (const auto& t : tool.triangles()) {
    const Eigen::Vector3d a = tool.vertices_T()[t[0]].cast<double>(), b = tool.vertices_T()[t[1]].cast<double>(),
                          c = tool.vertices_T()[t[2]].cast<double>();
    const int n = 1 + static_cast<int>(std::max({(b - a).norm(), (c - a).norm(), (c - b).norm()}) / spacing_m);
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; i + j <= n; ++j) places.emplace_back(a + (b - a) * i / n + (c - a) * j / n);
    }
  }
  return places;
}

/// A rod with a thin crossbar 0.3 m behind its tip.
inline ToolGeometry teeTool() {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  constexpr std::uint32_t kFaces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                                           {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  const std::array<Eigen::Vector3f, 4> corners = {
      Eigen::Vector3f(0, -0.01F, -0.01F), {0.5F, 0.01F, 0.01F}, {0.3F, -0.5F, -0.02F}, {0.31F, 0.5F, 0.02F}};
  for (std::size_t box = 0; box < 4; box += 2) {
    const Eigen::Vector3f &low = corners[box], &high = corners[box + 1];
    const auto first = static_cast<std::uint32_t>(vertices.size());
    for (int n = 0; n < 8; ++n)
      vertices.emplace_back((n & 1) != 0 ? high.x() : low.x(), (n & 2) != 0 ? high.y() : low.y(),
                            (n & 4) != 0 ? high.z() : low.z());
    for (const auto& face : kFaces) triangles.push_back({first + face[0], first + face[1], first + face[2]});
  }
  return ToolGeometry::fromTriangles(vertices, triangles, "tee");
}

/// A thin plate 6 cm behind the crossbar of that tool, where it touches the ball at its +x side.
inline void addPlate(AccessibilityField& field) {
  std::vector<Eigen::Vector3d> points_W, origins_W;
  const double x = kCentre_W.x() + kRadius_m + 0.31 + 0.06;
  for (double y = 0.3; y < 0.5; y += 0.01) {
    for (double z = -0.1; z < 0.1; z += 0.01) {
      points_W.emplace_back(x, y, kCentre_W.z() + z);
      origins_W.emplace_back(x - 0.05, y, kCentre_W.z() + z);  // what is behind it is unknown
    }
  }
  for (int n = 0; n < 20; ++n) field.integrateRays(points_W, origins_W);
}

}  // namespace accessvdb::test::ball_world
