// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/nearest_on_triangle.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace accessvdb::sim {
namespace {

using Corners = std::array<Eigen::Vector3d, 3>;

Corners corners(const TriangleMesh& mesh, std::uint32_t triangle) {
  const auto& t = mesh.triangles[triangle];
  return {mesh.vertices_W[t[0]].cast<double>(), mesh.vertices_W[t[1]].cast<double>(),
          mesh.vertices_W[t[2]].cast<double>()};
}

Eigen::Vector3d nearestOnSegment(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& p) {
  const Eigen::Vector3d along = b - a;
  const double length2 = along.squaredNorm();
  return length2 > 0 ? Eigen::Vector3d(a + std::clamp((p - a).dot(along) / length2, 0.0, 1.0) * along) : a;
}

}  // namespace

// Which of the seven regions (corners, edges, inside) the point's projection falls into follows from six dot products:
// C. Ericson, "Real-Time Collision Detection" (2005), section 5.1.5.
Eigen::Vector3d nearestOnTriangle(const TriangleMesh& mesh, std::uint32_t triangle, const Eigen::Vector3d& p_W) {
  const Corners corner = corners(mesh, triangle);
  const Eigen::Vector3d ab = corner[1] - corner[0], ac = corner[2] - corner[0];
  const Eigen::Vector3d ap = p_W - corner[0], bp = p_W - corner[1], cp = p_W - corner[2];
  const double ab_ap = ab.dot(ap), ac_ap = ac.dot(ap);
  if (ab_ap <= 0 && ac_ap <= 0) return corner[0];
  const double ab_bp = ab.dot(bp), ac_bp = ac.dot(bp);
  if (ab_bp >= 0 && ac_bp <= ab_bp) return corner[1];
  const double ab_cp = ab.dot(cp), ac_cp = ac.dot(cp);
  if (ac_cp >= 0 && ab_cp <= ac_cp) return corner[2];

  const double c = ab_ap * ac_bp - ab_bp * ac_ap, b = ab_cp * ac_ap - ab_ap * ac_cp, a = ab_bp * ac_cp - ab_cp * ac_bp;
  if (c <= 0 && ab_ap >= 0 && ab_bp <= 0) return corner[0] + ab_ap / (ab_ap - ab_bp) * ab;
  if (b <= 0 && ac_ap >= 0 && ac_cp <= 0) return corner[0] + ac_ap / (ac_ap - ac_cp) * ac;
  const double toward_c = ac_bp - ab_bp, toward_b = ab_cp - ac_cp;
  if (a <= 0 && toward_c >= 0 && toward_b >= 0)
    return corner[1] + toward_c / (toward_c + toward_b) * (corner[2] - corner[1]);
  const double sum = a + b + c;
  if (sum > 0) return corner[0] + b / sum * ab + c / sum * ac;

  // No area: uses the nearest of its edges.
  Eigen::Vector3d best = corner[0];
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d on_edge = nearestOnSegment(corner[k], corner[(k + 1) % 3], p_W);
    if ((on_edge - p_W).squaredNorm() < (best - p_W).squaredNorm()) best = on_edge;
  }
  return best;
}

Eigen::Vector3d triangleNormal(const TriangleMesh& mesh, std::uint32_t triangle) {
  const Corners corner = corners(mesh, triangle);
  return (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();  // Eigen leaves zero unchanged
}

double triangleArea(const TriangleMesh& mesh, std::uint32_t triangle) {
  const Corners corner = corners(mesh, triangle);
  return 0.5 * (corner[1] - corner[0]).cross(corner[2] - corner[0]).norm();
}

double angleFilled(const TriangleMesh& mesh, std::uint32_t triangle, const Eigen::Vector3d& point_W, double near_m) {
  const Corners corner = corners(mesh, triangle);
  for (std::size_t k = 0; k < 3; ++k) {
    if ((corner[k] - point_W).norm() > near_m) continue;
    const Eigen::Vector3d a = corner[(k + 1) % 3] - corner[k], b = corner[(k + 2) % 3] - corner[k];
    return std::atan2(a.cross(b).norm(), a.dot(b));
  }
  for (std::size_t k = 0; k < 3; ++k)
    if ((nearestOnSegment(corner[k], corner[(k + 1) % 3], point_W) - point_W).norm() <= near_m) return std::numbers::pi;
  return 2 * std::numbers::pi;
}

}  // namespace accessvdb::sim
