// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Geometry of one triangle of a mesh, in double.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "sim/triangle_mesh.h"

namespace accessvdb::sim {

/// The point of a triangle that is nearest to p_W. A triangle without area counts as the segment or point that it is.
[[nodiscard]] Eigen::Vector3d nearestOnTriangle(const TriangleMesh& mesh, std::uint32_t triangle,
                                                const Eigen::Vector3d& p_W);

/// Unit, outwards; zero for a triangle without area.
[[nodiscard]] Eigen::Vector3d triangleNormal(const TriangleMesh& mesh, std::uint32_t triangle);
[[nodiscard]] double triangleArea(const TriangleMesh& mesh, std::uint32_t triangle);

/// Angle that a triangle fills around one of its points: 2 pi inside, pi on an edge, its corner's angle at a corner.
/// @param near_m  a corner or edge closer than this counts as reached
[[nodiscard]] double angleFilled(const TriangleMesh& mesh, std::uint32_t triangle, const Eigen::Vector3d& point_W,
                                 double near_m);

}  // namespace accessvdb::sim
