// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One over the voxel size, made in one place: both backends agree bit for bit only while everybody multiplies by the
/// same number.
#pragma once

namespace accessvdb::kernels {

struct VoxelScale {
  double inverse;         ///< [1/m]
  float inverse_float32;  ///< [1/m] what points are mapped to voxels with (voxelIndex)

  explicit VoxelScale(double voxel_size_m)
      : inverse(1.0 / voxel_size_m), inverse_float32(static_cast<float>(1.0 / voxel_size_m)) {}
};

}  // namespace accessvdb::kernels
