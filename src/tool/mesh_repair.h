// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Turns a file's triangles into triangles with shared vertices and outward orientation, and answers whether the
/// surface is closed, which decides whether the tool has an inside.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace accessvdb::internal {

struct RepairedMesh {
  std::vector<Eigen::Vector3f> vertices;                ///< each used by at least one triangle
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< closed shells face outwards
  bool watertight = false;           ///< every edge is shared by two triangles (or balanced by direction)
  bool welded_by_tolerance = false;  ///< closed only after joining vertices closer than kWeldTolerance
  std::uint64_t zero_area = 0;       ///< triangles without area; dropped
  std::uint64_t zero_area_kept = 0;  ///< the same, kept because they close the surface
  std::uint64_t duplicates = 0;      ///< equal triangles beyond the first, either way round; dropped
  std::uint64_t flipped = 0;         ///< triangles flipped to agree with their neighbours
  std::uint64_t open_edges = 0;      ///< edges that keep the surface from being closed
};

/// Vertices closer than this share of the mesh's largest extent count as one if the exact positions leave the mesh
/// open: ten times the rounding of a float32 coordinate.
inline constexpr double kWeldTolerance = 1e-6;

/// @param triangles  indices must be in range. The result is empty if no triangle has an area.
RepairedMesh repairMesh(const std::vector<Eigen::Vector3f>& vertices,
                        const std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace accessvdb::internal
