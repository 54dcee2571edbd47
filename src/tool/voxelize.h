// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Triangles to voxels: cells that the surface touches, and cells whose centre is inside.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::internal {

/// Voxels (i, j, lo .. hi), both ends included.
struct VoxelRun {
  std::int32_t i, j, lo, hi;
};

/// Voxel (i,j,k) is the closed cube of edge 1 around the point (i,j,k).
/// @param vertices  in voxels
/// @param solid     also take voxels whose centre has a winding number other than 0; the mesh must be closed
/// @return disjoint, not touching, sorted by (i, j, lo)
std::vector<VoxelRun> voxelize(const std::vector<Eigen::Vector3d>& vertices,
                               const std::vector<std::array<std::uint32_t, 3>>& triangles, bool solid);

/// Voxels that the surface touches, or a place that is nearer to it than the margin along each axis.
/// @param vertices, margin  in voxels  @return as voxelize()
std::vector<VoxelRun> touchedVoxels(const std::vector<Eigen::Vector3d>& vertices,
                                    const std::vector<std::array<std::uint32_t, 3>>& triangles, double margin);

/// Voxels whose centre has a winding number other than 0, whatever the surface touches.
/// @param vertices  in voxels; the mesh must be closed  @return as voxelize()
std::vector<VoxelRun> voxelsInside(const std::vector<Eigen::Vector3d>& vertices,
                                   const std::vector<std::array<std::uint32_t, 3>>& triangles);

/// Removes voxels with i*i + j*j + k*k <= radius*radius. @return number removed
std::uint64_t removeBall(std::vector<VoxelRun>& runs, double radius);

std::uint64_t countVoxels(const std::vector<VoxelRun>& runs);

/// Packs runs into columns of up to 64 bits, each beginning at its lowest voxel, sorted by (dx, dy, dz).
std::vector<kernels::VoxelColumn> packColumns(const std::vector<VoxelRun>& runs);

}  // namespace accessvdb::internal
