// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/builtin_tools.h"

#include <cmath>
#include <initializer_list>
#include <numbers>

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {

struct Ring {
  double x_m, radius_m;
};

/// A closed body of revolution around +x: its ends are closed to their centres; a ring of radius 0 is an apex.
void addTurned(BuiltinMesh& mesh, std::initializer_list<Ring> rings, int sides) {
  const auto base = std::uint32_t(mesh.vertices_T.size());
  const auto n = std::uint32_t(sides);
  for (const Ring& ring : rings) {
    for (int s = 0; s < sides; ++s) {
      const double angle = 2 * std::numbers::pi * s / sides;
      mesh.vertices_T.emplace_back(float(ring.x_m), float(ring.radius_m * std::cos(angle)),
                                   float(ring.radius_m * std::sin(angle)));
    }
  }
  const auto num_rings = std::uint32_t(rings.size());
  for (std::uint32_t r = 0; r + 1 < num_rings; ++r) {
    for (std::uint32_t s = 0; s < n; ++s) {
      const std::uint32_t a = base + r * n + s, b = base + r * n + (s + 1) % n, c = a + n, d = b + n;
      if (rings.begin()[r].radius_m > 0) mesh.triangles.push_back({a, c, b});
      if (rings.begin()[r + 1].radius_m > 0) mesh.triangles.push_back({b, c, d});
    }
  }
  const auto front = std::uint32_t(mesh.vertices_T.size());
  mesh.vertices_T.emplace_back(float(rings.begin()->x_m), 0.f, 0.f);
  mesh.vertices_T.emplace_back(float((rings.end() - 1)->x_m), 0.f, 0.f);
  for (std::uint32_t s = 0; s < n; ++s) {
    const std::uint32_t last = base + (num_rings - 1) * n;
    if (rings.begin()->radius_m > 0) mesh.triangles.push_back({front, base + s, base + (s + 1) % n});
    if ((rings.end() - 1)->radius_m > 0) mesh.triangles.push_back({front + 1, last + (s + 1) % n, last + s});
  }
}

void addBox(BuiltinMesh& mesh, const Eigen::Vector3d& low_m, const Eigen::Vector3d& high_m) {
  const auto base = std::uint32_t(mesh.vertices_T.size());
  for (int corner = 0; corner < 8; ++corner) {
    mesh.vertices_T.emplace_back(float((corner & 1 ? high_m : low_m).x()), float((corner & 2 ? high_m : low_m).y()),
                                 float((corner & 4 ? high_m : low_m).z()));
  }
  constexpr std::array<std::array<std::uint32_t, 4>, 6> kFaces = {
      {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};
  for (const auto& f : kFaces) {
    mesh.triangles.push_back({base + f[0], base + f[1], base + f[2]});
    mesh.triangles.push_back({base + f[0], base + f[2], base + f[3]});
  }
}

}  // namespace

BuiltinMesh builtinMesh(const std::string& name) {
  BuiltinMesh mesh;
  if (name == "builtin:pencil") {
    // 0.15 m long, 8 mm thick; the tip is a cone 20 mm long.
    addTurned(mesh, {{0, 0}, {0.02, 0.004}, {0.15, 0.004}}, 24);
  } else if (name == "builtin:pruner") {
    // Cutter head: 80 mm long, 12 mm wide at the mouth, 50 mm at the back.
    addTurned(mesh, {{0, 0.006}, {0.05, 0.025}, {0.08, 0.025}}, 24);
    // Boom: 36 mm thick, from the head to the body.
    addTurned(mesh, {{0.07, 0.018}, {0.65, 0.018}}, 24);
    // The flying body: 0.5 x 0.5 x 0.2 m, its front 0.6 m behind the tip.
    addBox(mesh, {0.6, -0.25, -0.1}, {1.1, 0.25, 0.1});
  } else {
    throw InvalidArgument("tool.builtin", name, "there is no builtin tool with this name",
                          "Use builtin:pencil, builtin:pruner or the path of a mesh");
  }
  return mesh;
}

}  // namespace accessvdb::internal
