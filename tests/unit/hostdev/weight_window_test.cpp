// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Oracle: the voxels around one, each by itself.
#include "hostdev/weight_window.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <random>

namespace accessvdb::kernels {
namespace {

TEST(WeightWindow, HasEachVoxelAroundOneInThePartOfItsLeaf) {
  using Voxel = std::array<std::int32_t, 3>;
  std::mt19937 random(5);
  for (int n = 0; n < 300; ++n) {
    Voxel own;
    for (std::int32_t& x : own) x = static_cast<std::int32_t>(random() % 41) - 20;
    const int reach = static_cast<int>(random() % 5);
    std::map<Voxel, int> seen;
    int with_own = 0;
    for (int part = 0; part < kWindowParts; ++part) {
      const WindowPart window = windowPart(own.data(), reach, part);
      if (window.empty()) {
        EXPECT_FALSE(window.holds(own.data()));
        continue;
      }
      with_own += window.holds(own.data()) ? 1 : 0;
      for (std::size_t axis = 0; axis < 3; ++axis) EXPECT_EQ(window.first[axis] >> 3, window.last[axis] >> 3);
      for (std::int32_t x = window.first[0]; x <= window.last[0]; ++x)
        for (std::int32_t y = window.first[1]; y <= window.last[1]; ++y)
          for (std::int32_t z = window.first[2]; z <= window.last[2]; ++z) ++seen[{x, y, z}];
    }
    EXPECT_EQ(with_own, 1);
    std::size_t around = 0;
    for (std::int32_t x = own[0] - reach; x <= own[0] + reach; ++x)
      for (std::int32_t y = own[1] - reach; y <= own[1] + reach; ++y)
        for (std::int32_t z = own[2] - reach; z <= own[2] + reach; ++z, ++around)
          EXPECT_EQ(seen[(Voxel{x, y, z})], 1) << n << ", reach " << reach;
    EXPECT_EQ(seen.size(), around);
  }
}

}  // namespace
}  // namespace accessvdb::kernels
