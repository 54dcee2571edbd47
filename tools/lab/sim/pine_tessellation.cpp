// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/pine_tessellation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

/// Right-handed: side x up = axis.
struct Across {
  Vector3d axis, side, up;

  explicit Across(const Vector3d& along) : axis(along.normalized()) {
    side = (std::abs(axis.z()) < 0.9 ? axis.cross(Vector3d::UnitZ()) : axis.cross(Vector3d::UnitX())).normalized();
    up = axis.cross(side);
  }
  Vector3d around(double angle_rad) const { return std::cos(angle_rad) * side + std::sin(angle_rad) * up; }
};

/// Fewest equal steps over an arc of this radius such that the chords stay within the error.
int stepsOver(double arc_rad, double radius_m, double chord_error_m) {
  const double step_rad = 2 * std::acos(std::max(0.0, 1 - chord_error_m / radius_m));
  return std::max(1, int(std::ceil(arc_rad / step_rad - 1e-9)));
}

}  // namespace

void appendRoundCone(const RoundCone& cone, double chord_error_m, TriangleMesh& mesh) {
  const double length_m = (cone.b_W - cone.a_W).norm();
  const double thickest_m = std::max(cone.radius_a_m, cone.radius_b_m);
  // Half of the error for the chords around the axis, half for those along the caps: together they stay within it.
  const int sides = std::max(5, stepsOver(2 * std::numbers::pi, thickest_m, 0.5 * chord_error_m));
  // The straight flank touches both spheres at this angle above their equators (towards b if a is thicker).
  const double flank_rad = std::asin(std::clamp((cone.radius_a_m - cone.radius_b_m) / length_m, -0.99, 0.99));
  const double from_a = flank_rad + std::numbers::pi / 2, from_b = std::numbers::pi / 2 - flank_rad;  // poles to flank
  const int rings_a = stepsOver(from_a, cone.radius_a_m, 0.5 * chord_error_m);
  const int rings_b = stepsOver(from_b, cone.radius_b_m, 0.5 * chord_error_m);

  const Across frame(cone.b_W - cone.a_W);
  const auto begin = std::uint32_t(mesh.vertices_W.size());
  const auto addRing = [&](const Vector3d& centre, double radius_m, double latitude_rad) {
    for (int k = 0; k < sides; ++k)
      mesh.vertices_W.push_back(
          (centre + radius_m * (std::sin(latitude_rad) * frame.axis +
                                std::cos(latitude_rad) * frame.around(2 * std::numbers::pi * k / sides)))
              .cast<float>());
  };
  mesh.vertices_W.push_back((cone.a_W - cone.radius_a_m * frame.axis).cast<float>());
  for (int n = 1; n <= rings_a; ++n) addRing(cone.a_W, cone.radius_a_m, -std::numbers::pi / 2 + from_a * n / rings_a);
  for (int n = rings_b; n >= 1; --n) addRing(cone.b_W, cone.radius_b_m, std::numbers::pi / 2 - from_b * n / rings_b);
  const auto end = std::uint32_t(mesh.vertices_W.size());
  mesh.vertices_W.push_back((cone.b_W + cone.radius_b_m * frame.axis).cast<float>());

  const auto count = std::uint32_t(sides);
  for (std::uint32_t k = 0; k < count; ++k) {
    const std::uint32_t next = (k + 1) % count;
    mesh.triangles.push_back({begin, begin + 1 + next, begin + 1 + k});
    for (std::uint32_t ring = begin + 1; ring + count < end; ring += count) {
      mesh.triangles.push_back({ring + k, ring + next, ring + count + k});
      mesh.triangles.push_back({ring + next, ring + count + next, ring + count + k});
    }
    mesh.triangles.push_back({end, end - count + k, end - count + next});
  }
}

void appendNeedle(const RoundCone& needle, TriangleMesh& mesh) {
  const Across frame(needle.b_W - needle.a_W);
  const auto begin = std::uint32_t(mesh.vertices_W.size());
  for (int k = 0; k < 3; ++k)
    mesh.vertices_W.push_back(
        (needle.a_W + needle.radius_a_m * frame.around(2 * std::numbers::pi * k / 3)).cast<float>());
  mesh.vertices_W.push_back((needle.b_W + needle.radius_b_m * frame.axis).cast<float>());
  mesh.triangles.push_back({begin, begin + 2, begin + 1});
  for (std::uint32_t k = 0; k < 3; ++k) mesh.triangles.push_back({begin + k, begin + (k + 1) % 3, begin + 3});
}

}  // namespace accessvdb::sim
