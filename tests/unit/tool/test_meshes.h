// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Meshes whose shape is known in closed form, and the path of real data.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <numbers>
#include <vector>

#include "support/box_tool.h"

namespace accessvdb::test {

struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;

  void add(const Mesh& other) {
    const auto base = std::uint32_t(vertices.size());
    vertices.insert(vertices.end(), other.vertices.begin(), other.vertices.end());
    for (const auto& t : other.triangles) triangles.push_back({base + t[0], base + t[1], base + t[2]});
  }
};

inline Mesh box(const Eigen::Vector3f& low, const Eigen::Vector3f& high) {
  Mesh m;
  appendBox(m.vertices, m.triangles, low, high);
  return m;
}

/// Faces outwards. Tube radius 0 is not allowed.
inline Mesh torus(const Eigen::Vector3f& centre, double ring, double tube, int steps, int sides) {
  Mesh m;
  for (int a = 0; a < steps; ++a) {
    for (int b = 0; b < sides; ++b) {
      const double u = 2 * std::numbers::pi * a / steps, w = 2 * std::numbers::pi * b / sides;
      const double r = ring + tube * std::cos(w);
      m.vertices.push_back(centre +
                           Eigen::Vector3d(r * std::cos(u), r * std::sin(u), tube * std::sin(w)).cast<float>());
      const auto at = [&](int i, int j) { return std::uint32_t((i % steps) * sides + j % sides); };
      m.triangles.push_back({at(a, b), at(a + 1, b), at(a + 1, b + 1)});
      m.triangles.push_back({at(a, b), at(a + 1, b + 1), at(a, b + 1)});
    }
  }
  return m;
}

inline std::filesystem::path testData() {
  if (const char* given = std::getenv("ACCESSVDB_TEST_DATA")) return given;
  return std::filesystem::path(ACCESSVDB_SOURCE_DIR) / ".." / "shared" / "data";
}

}  // namespace accessvdb::test
