// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// From triangles as they stand in a file to triangles with shared vertices, outward orientation, and the answer to
/// "is it closed?", which decides whether the tool has an inside.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace accessvdb::internal {

struct RepairedMesh {
  std::vector<Eigen::Vector3f> vertices;                ///< each used by some triangle
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< closed shells face outwards
  bool watertight = false;           ///< every edge is shared by two triangles (or balanced by direction)
  bool welded_by_tolerance = false;  ///< closed only after joining vertices nearer than kWeldTolerance
  std::uint64_t zero_area = 0;       ///< triangles without area; dropped
  std::uint64_t zero_area_kept = 0;  ///< the same, kept because they close the surface
  std::uint64_t duplicates = 0;      ///< equal triangles beyond the first; dropped
  std::uint64_t flipped = 0;         ///< triangles turned round to agree with their neighbours
  std::uint64_t open_edges = 0;      ///< edges that keep it from being closed
};

/// Vertices nearer than this share of the mesh's largest extent count as one where the exact positions leave it open:
/// ten times the rounding of a float32 coordinate.
inline constexpr double kWeldTolerance = 1e-6;

/// @param triangles  indices must be in range. The result may be empty where no triangle has an area.
RepairedMesh repairMesh(const std::vector<Eigen::Vector3f>& vertices,
                        const std::vector<std::array<std::uint32_t, 3>>& triangles);

}  // namespace accessvdb::internal
