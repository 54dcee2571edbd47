// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which voxel a position has, for what reads and writes files: hostdev/position_voxel.h again, bit for bit, since
/// these layers know nothing of kernels. tests/unit/io/voxel_rule_test.cpp compares the two.
#pragma once

#include <cmath>

namespace accessvdb::internal {

/// Index of the voxel of a coordinate, as a whole number: not finite for NaN and infinity. Faces belong to the voxel
/// above; what is within rounding of a face is on it.
/// @param x_m  local frame
inline double voxelOfCoordinate(double x_m, double voxel_size_m) {
  const double inverse = static_cast<float>(1.0 / voxel_size_m), x = x_m * inverse;
  const double rounding = 0x1.0p-19 * inverse + 5 * 0x1.0p-24 * std::abs(x);
  return std::floor(x + 0.5 + 0.5 * rounding);
}

}  // namespace accessvdb::internal
