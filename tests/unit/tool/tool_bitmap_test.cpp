// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Blocks of voxels that a tool may enter, against each of their voxels by itself.
#include "tool/tool_bitmap.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <random>

#include "accessvdb/tool_geometry.h"
#include "hostdev/tool_fit.h"

namespace accessvdb::internal {
namespace {

using kernels::ToolPlace;

class BitmapOf : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(VoxelSize, BitmapOf, testing::Values(0.02, 0.05, 0.11));

TEST_P(BitmapOf, BlocksHideNoVoxel) {
  const ToolBitmap bitmap(ToolGeometry::builtin("builtin:pruner"), GetParam());
  const kernels::ToolBitmapView tool = bitmap.view(bitmap.words.data());
  std::mt19937 engine(4);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> within(-0.5, 0.5);
  const double inverse = 1 / GetParam();
  std::uint64_t entered = 0, shut_out = 0, kept = 0;
  for (int n = 0; n < 60; ++n) {
    const Eigen::Matrix3d R =
        Eigen::Quaterniond(normal(engine), normal(engine), normal(engine), normal(engine)).normalized().matrix();
    const Eigen::Vector3d tip_L(within(engine), within(engine), within(engine));
    ToolPlace place;
    ASSERT_TRUE(kernels::makeToolPlace(R.data(), tip_L.data(), static_cast<float>(inverse), place));
    std::int32_t first[3], last[3];
    kernels::tool_fit::leavesAround(place, tool, first, last);
    for (std::int32_t i = first[0]; i <= last[0]; ++i) {
      for (std::int32_t j = first[1]; j <= last[1]; ++j) {
        for (std::int32_t k = first[2]; k <= last[2]; ++k) {
          const float corner[3] = {static_cast<float>(8 * i - place.anchor[0]),
                                   static_cast<float>(8 * j - place.anchor[1]),
                                   static_cast<float>(8 * k - place.anchor[2])};
          const std::uint32_t blocks = kernels::tool_fit::blocksOf(place, tool, corner);
          for (int x = 0; x < 8; ++x) {
            const std::uint64_t possible = kernels::tool_fit::voxelsOf(blocks, x);
            const float low[3] = {corner[0] + static_cast<float>(x), corner[1], corner[2]};
            const std::uint64_t found =
                kernels::tool_fit::toolVoxels(place, tool, low, ~std::uint64_t{0}, kernels::tool_fit::PlainRows());
            EXPECT_EQ(found & ~possible, 0U) << n;
            entered += kernels::tool_fit::countOf(found);
            shut_out += kernels::tool_fit::countOf(~possible);
            kept += kernels::tool_fit::countOf(possible);
          }
        }
      }
    }
  }
  EXPECT_GT(entered, 1000U);
  EXPECT_GT(shut_out, kept);  // else they decide nothing
}

}  // namespace
}  // namespace accessvdb::internal
