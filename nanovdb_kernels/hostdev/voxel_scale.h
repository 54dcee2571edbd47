// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The reciprocal of the voxel size, computed in one place: the backends agree bit for bit only if all code multiplies
/// by the same number.
#pragma once

namespace accessvdb::kernels {

struct VoxelScale {
  double inverse;         ///< [1/m]
  float inverse_float32;  ///< [1/m] maps points to voxels (voxelIndex)

  explicit VoxelScale(double voxel_size_m)
      : inverse(1.0 / voxel_size_m), inverse_float32(static_cast<float>(1.0 / voxel_size_m)) {}
};

}  // namespace accessvdb::kernels
