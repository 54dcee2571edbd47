// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Closed boxes of twelve triangles, and a tool made of one.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "accessvdb/tool_geometry.h"

namespace accessvdb::test {

/// Appends a box, faces outwards. @param low, high  opposite corners, in any unit
inline void appendBox(std::vector<Eigen::Vector3f>& vertices, std::vector<std::array<std::uint32_t, 3>>& triangles,
                      const Eigen::Vector3f& low, const Eigen::Vector3f& high) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (int n = 0; n < 8; ++n) {
    vertices.emplace_back((n & 1) != 0 ? high.x() : low.x(), (n & 2) != 0 ? high.y() : low.y(),
                          (n & 4) != 0 ? high.z() : low.z());
  }
  constexpr std::array<std::array<std::uint32_t, 3>, 12> kFaces = {{{0, 2, 1},
                                                                    {1, 2, 3},
                                                                    {4, 5, 6},
                                                                    {5, 7, 6},
                                                                    {0, 1, 4},
                                                                    {1, 5, 4},
                                                                    {2, 6, 3},
                                                                    {3, 6, 7},
                                                                    {0, 4, 2},
                                                                    {2, 4, 6},
                                                                    {1, 3, 5},
                                                                    {3, 7, 5}}};
  for (const auto& face : kFaces) triangles.push_back({first + face[0], first + face[1], first + face[2]});
}

/// @param low_T, high_T  opposite corners in the tool frame, metres
inline ToolGeometry boxTool(const Eigen::Vector3f& low_T, const Eigen::Vector3f& high_T,
                            const std::string& name = "box") {
  std::vector<Eigen::Vector3f> vertices_T;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  appendBox(vertices_T, triangles, low_T, high_T);
  return ToolGeometry::fromTriangles(vertices_T, triangles, name);
}

}  // namespace accessvdb::test
