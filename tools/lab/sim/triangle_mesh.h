// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A surface of triangles in the world frame, metres; outward normals follow from counter-clockwise order.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace accessvdb::sim {

/// May consist of several closed parts that overlap (a tree of overlapping branches): inside = inside any of them.
struct TriangleMesh {
  std::vector<Eigen::Vector3f> vertices_W;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

}  // namespace accessvdb::sim
