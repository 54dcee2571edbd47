// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/tessellation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <unordered_map>
#include <utility>
#include <vector>

#include "sim/angles.h"

namespace accessvdb::sim {
namespace {

constexpr int kFewestSegments = 48, kMostSegments = 2048;
constexpr int kMostSubdivisions = 8;  // 20 * 4^8 = 1.3 M triangles

/// Half a unit in the last place of a coordinate of this size, for three coordinates.
double roundingError_m(double size_m) { return std::sqrt(3.0) * 0.5 * std::numeric_limits<float>::epsilon() * size_m; }

int segments(double step_rad) {
  return static_cast<int>(std::clamp(std::ceil(kTurn / step_rad), double{kFewestSegments}, double{kMostSegments}));
}

/// A sphere's facets being subdivided: each new vertex is shared by the two triangles at its edge.
struct Icosphere {
  std::vector<Eigen::Vector3d> vertices;  // unit
  std::vector<std::array<std::uint32_t, 3>> triangles;

  Icosphere() {
    const double g = std::numbers::phi;
    for (const double a : {-1.0, 1.0}) {
      for (const double b : {-g, g}) {
        vertices.emplace_back(Eigen::Vector3d(0, a, b).normalized());
        vertices.emplace_back(Eigen::Vector3d(a, b, 0).normalized());
        vertices.emplace_back(Eigen::Vector3d(b, 0, a).normalized());
      }
    }
    // The 20 faces are the triples of mutually nearest vertices.
    const double edge = (vertices[0] - Eigen::Vector3d(0, 1, -g).normalized()).norm() * 1.001;
    const auto near = [&](std::uint32_t i, std::uint32_t j) { return (vertices[i] - vertices[j]).norm() < edge; };
    for (std::uint32_t i = 0; i < 12; ++i) {
      for (std::uint32_t j = i + 1; j < 12; ++j) {
        for (std::uint32_t k = j + 1; k < 12; ++k) {
          if (!near(i, j) || !near(j, k) || !near(i, k)) continue;
          const Eigen::Vector3d normal = (vertices[j] - vertices[i]).cross(vertices[k] - vertices[i]);
          if (normal.dot(vertices[i]) > 0) {
            triangles.push_back({i, j, k});
          } else {
            triangles.push_back({i, k, j});
          }
        }
      }
    }
  }

  void divide() {
    std::unordered_map<std::uint64_t, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t i, std::uint32_t j) {
      const auto [low, high] = std::minmax(i, j);
      const auto [entry, fresh] =
          middles.try_emplace((std::uint64_t{low} << 32) | high, static_cast<std::uint32_t>(vertices.size()));
      if (fresh) vertices.emplace_back((vertices[low] + vertices[high]).normalized());
      return entry->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    finer.reserve(4 * triangles.size());
    for (const auto& [a, b, c] : triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    triangles = std::move(finer);
  }

  /// Depth of the worst facet's plane inside the unit sphere.
  [[nodiscard]] double depth() const {
    double nearest_plane = 1;
    for (const auto& [a, b, c] : triangles) {
      const Eigen::Vector3d normal = (vertices[b] - vertices[a]).cross(vertices[c] - vertices[a]).normalized();
      nearest_plane = std::min(nearest_plane, normal.dot(vertices[a]));
    }
    return 1 - nearest_plane;
  }
};

}  // namespace

Tessellation tessellateTorus(double major_radius_m, double minor_radius_m, double error_m) {
  // A facet interpolates f(u, v) linearly over du x dv, so that it is off by at most
  // (|f_uu| du^2 + 2 |f_uv| du dv + |f_vv| dv^2) / 8, with |f_uu| <= R + r, |f_uv| <= r, |f_vv| = r.
  const double R = major_radius_m, r = minor_radius_m;
  const int nu = segments(std::sqrt(8 * error_m / (3 * (R + r))));
  const int nv = segments(std::sqrt(8 * error_m / (3 * r)));
  const double du = kTurn / nu, dv = kTurn / nv;

  Tessellation out;
  out.error_m = ((R + r) * du * du + 2 * r * du * dv + r * dv * dv) / 8 + roundingError_m(R + r);
  out.mesh.vertices_W.reserve(static_cast<std::size_t>(nu) * static_cast<std::size_t>(nv));
  out.mesh.triangles.reserve(out.mesh.vertices_W.capacity() * 2);
  for (int i = 0; i < nu; ++i) {
    for (int j = 0; j < nv; ++j) {
      const double u = du * i, v = dv * j, rho = R + r * std::cos(v);
      out.mesh.vertices_W.emplace_back(
          Eigen::Vector3d(rho * std::cos(u), rho * std::sin(u), r * std::sin(v)).cast<float>());
      const auto index = [&](int a, int b) { return static_cast<std::uint32_t>((a % nu) * nv + b % nv); };
      const std::uint32_t p = index(i, j), q = index(i + 1, j), s = index(i + 1, j + 1), t = index(i, j + 1);
      out.mesh.triangles.push_back({p, q, s});
      out.mesh.triangles.push_back({p, s, t});
    }
  }
  return out;
}

Tessellation tessellateSphere(double radius_m, double error_m) {
  Icosphere ball;
  for (int n = 0; n < kMostSubdivisions && ball.depth() * radius_m > error_m; ++n) ball.divide();
  Tessellation out;
  out.error_m = ball.depth() * radius_m + roundingError_m(radius_m);
  out.mesh.triangles = std::move(ball.triangles);
  out.mesh.vertices_W.reserve(ball.vertices.size());
  for (const Eigen::Vector3d& vertex : ball.vertices) {
    out.mesh.vertices_W.emplace_back((radius_m * vertex).cast<float>());
  }
  return out;
}

Tessellation tessellateTurned(const std::vector<Eigen::Vector2d>& profile_m, double error_m) {
  double reach_m = 0, farthest_m = 0;
  for (const Eigen::Vector2d& corner : profile_m) {
    reach_m = std::max(reach_m, corner.x());
    farthest_m = std::max(farthest_m, corner.norm());
  }
  // A chord's middle is r (1 - cos(step / 2)) <= r step^2 / 8 inside its circle.
  const int n = segments(std::sqrt(8 * error_m / reach_m));
  Tessellation out;
  out.error_m = reach_m * (1 - std::cos(0.5 * kTurn / n)) + roundingError_m(farthest_m);
  /// First vertex of a corner's circle; on the axis the circle is one vertex.
  std::vector<std::uint32_t> first;
  const auto around = [&](std::size_t corner) { return profile_m[corner].x() > 0 ? n : 1; };
  for (std::size_t corner = 0; corner < profile_m.size(); ++corner) {
    first.push_back(static_cast<std::uint32_t>(out.mesh.vertices_W.size()));
    for (int i = 0; i < around(corner); ++i) {
      const double u = kTurn * i / n;
      const Eigen::Vector2d& c = profile_m[corner];
      out.mesh.vertices_W.emplace_back(Eigen::Vector3d(c.x() * std::cos(u), c.x() * std::sin(u), c.y()).cast<float>());
    }
  }
  for (std::size_t corner = 0; corner + 1 < profile_m.size(); ++corner) {
    const auto vertex = [&](std::size_t at, int i) { return first[at] + static_cast<std::uint32_t>(i % around(at)); };
    for (int i = 0; i < n; ++i) {
      const std::uint32_t a = vertex(corner, i), b = vertex(corner, i + 1);
      const std::uint32_t c = vertex(corner + 1, i), d = vertex(corner + 1, i + 1);
      if (a != b) out.mesh.triangles.push_back({a, b, c});
      if (c != d) out.mesh.triangles.push_back({b, d, c});
    }
  }
  return out;
}

Tessellation tessellateBox(const Eigen::Vector3d& size_m) {
  Tessellation out;
  out.error_m = roundingError_m(0.5 * size_m.maxCoeff());
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
    out.mesh.vertices_W.emplace_back(sign.cwiseProduct(size_m).cast<float>());
  }
  // Corners counter-clockwise from outside; bit 0 of a corner is +x, bit 1 +y, bit 2 +z.
  constexpr std::uint32_t kFaces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                          {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
  for (const auto& face : kFaces) {
    out.mesh.triangles.push_back({face[0], face[1], face[2]});
    out.mesh.triangles.push_back({face[0], face[2], face[3]});
  }
  return out;
}

}  // namespace accessvdb::sim
