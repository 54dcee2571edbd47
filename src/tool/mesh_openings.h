// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where a surface that should be closed is not: its rims, and how wide the openings between them are.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace accessvdb::internal {

struct Opening {
  std::vector<std::array<std::uint32_t, 2>> rims;  ///< edges at which the surface ends
  double radius_m = 0;                             ///< what is missing is nearer than this to a rim; 0: not known
  double bulge_m = 0;  ///< and no farther than this outside all planes that have all rims on one side
};

struct MeshOpenings {
  std::vector<Opening> openings;
  double tear_m = 0;   ///< vertices that were one are at most so far apart, and the surface that far from where it was
  double width_m = 0;  ///< of the widest opening; 0: none, infinity: a sheet, which has no other side

  [[nodiscard]] bool any() const { return width_m > 0; }
};

/// Openings wider than this share of the mesh's largest extent are not closed: what is missing could be anything.
inline constexpr double kWidestOpening = 0.25;

/// Edges that an odd number of triangles use are rims; which way triangles face does not matter. Vertices on rims that
/// are nearer to each other than half their edges are taken for one that was torn apart. The width of an opening is the
/// diameter of the largest ball that touches its rim from inside and has no rim within: for a crack its breadth, not
/// its length.
/// @param vertices  metres, those at the same place only once
[[nodiscard]] MeshOpenings findOpenings(const std::vector<Eigen::Vector3f>& vertices,
                                        const std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace accessvdb::internal
