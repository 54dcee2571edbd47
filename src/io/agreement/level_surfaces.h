// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is up, by the flat patches that scans see: floors, ground, ceilings and walls.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace accessvdb::io {

/// Appends the normals of flat patches, one per cell of that size, in the frame of the points.
void appendPatchNormals(const std::vector<Eigen::Vector3f>& points, float cell_m,
                        std::vector<Eigen::Vector3f>& normals);

/// The direction that floors and walls speak for, where z is none of those and they are many; else nothing. A scene
/// that is turned by a right angle looks like one that is not.
/// @param normals_W  of patches, either sign
[[nodiscard]] std::optional<Eigen::Vector3d> upBesideZ(const std::vector<Eigen::Vector3f>& normals_W);

}  // namespace accessvdb::io
