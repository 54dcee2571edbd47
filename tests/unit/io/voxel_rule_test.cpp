// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/voxel_rule.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "hostdev/position_voxel.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::test {
namespace {

TEST(VoxelRule, IsThatOfTheKernels) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const double voxel_m : {0.0005, 0.01, 0.03, 0.05, 0.0625, 1.0 / 3, 10.0}) {
    const kernels::VoxelScale scale(voxel_m);
    for (int n = 0; n < 100'000; ++n) {
      double x_m = std::exp2(n % 20) * unit(random) * voxel_m;
      if (n % 2 == 0) {  // at the border between two voxels, which is a little below a face
        const double face = std::floor(x_m / voxel_m) + 0.5, most = kernels::roundingAtFaces(face, 1 / voxel_m);
        x_m = (face - (0.5 + 1e-6 * unit(random)) * most) * voxel_m;
      }
      ASSERT_EQ(internal::voxelOfCoordinate(x_m, voxel_m), kernels::voxelOfCoordinate(x_m, scale.inverse_float32))
          << x_m << " " << voxel_m;
    }
  }
  EXPECT_TRUE(std::isnan(internal::voxelOfCoordinate(std::numeric_limits<double>::quiet_NaN(), 0.1)));
}

}  // namespace
}  // namespace accessvdb::test
