// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much surface a point stands for (docs/report.md, "Area").
#pragma once

#include <Eigen/Core>

namespace accessvdb::internal {

/// Each voxel that holds a return has one point, which lies on the surface: the part of its tangent plane inside the
/// voxel. Voxels of which the surface only cuts a corner often have no return, but then little is missing.
/// @param place  of the point in its voxel, in voxels from its lowest corner
/// @param normal_W  unit, or zero where there is none: then the mean over all planes through all places is taken
/// @return square metres
[[nodiscard]] double areaOfPoint_m2(const Eigen::Vector3d& place, const Eigen::Vector3f& normal_W, double voxel_size_m);

/// Where one point is scored of those that lie along a normal's main axis, it stands for the part of its tangent plane
/// above its cell across that axis. @param normal_W  not zero
[[nodiscard]] double areaOfCell_m2(const Eigen::Vector3f& normal_W, double cell_m);

}  // namespace accessvdb::internal
