// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How much surface a point stands for (docs/report.md, "Area").
#pragma once

#include <Eigen/Core>

namespace accessvdb::internal {

/// A plane with the unit normal n passes through (|nx| + |ny| + |nz|) / v^2 voxels per square metre: as many as fit
/// into the slab of centres whose voxels it touches, which is v (|nx| + |ny| + |nz|) thick. Each voxel that holds a
/// return has one point, so a point stands for the inverse of that.
/// @param normal_W  unit, or zero where there is none: then the mean over all directions, 3/2, is taken
/// @return square metres
[[nodiscard]] inline double areaOfPoint_m2(const Eigen::Vector3f& normal_W, double voxel_size_m) {
  const double sum = normal_W.cast<double>().cwiseAbs().sum();
  return voxel_size_m * voxel_size_m / (sum > 0 ? sum : 1.5);
}

}  // namespace accessvdb::internal
