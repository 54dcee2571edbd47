// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Closed meshes of smooth shapes, vertices on the shape, with a bound on how far the facets are from it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

struct Tessellation {
  TriangleMesh mesh;
  double error_m = 0;  ///< no point of the mesh is farther than this from the shape, nor of the shape from the mesh
};

/// All centred at the origin. @param error_m  target; met unless the mesh would exceed about 2 M triangles
[[nodiscard]] Tessellation tessellateTorus(double major_radius_m, double minor_radius_m, double error_m);
[[nodiscard]] Tessellation tessellateSphere(double radius_m, double error_m);
/// A solid of revolution around the z axis. @param profile_m  as for TurnedDistance
[[nodiscard]] Tessellation tessellateTurned(const std::vector<Eigen::Vector2d>& profile_m, double error_m);
/// Two triangles per face; exact except for rounding to float.
[[nodiscard]] Tessellation tessellateBox(const Eigen::Vector3d& size_m);

}  // namespace accessvdb::sim
