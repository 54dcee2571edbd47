// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bits against a plain set of voxels.
#include "tool/voxel_bitmap.h"

#include <gtest/gtest.h>

#include <random>
#include <set>
#include <tuple>

namespace accessvdb::internal {
namespace {

using Cells = std::set<std::tuple<int, int, int>>;

TEST(VoxelBitmap, HoldsWhatWasAdded) {
  std::mt19937 random(7);
  const auto upTo = [&](int most) { return static_cast<int>(random() % static_cast<unsigned>(most + 1)); };
  for (const int height : {0, 5, 62, 63, 64, 126, 127, 128, 200}) {  // with and without a rest beyond whole words
    const VoxelBitmap::Box box = {{-3, 5, -90}, {-1, 8, -90 + height}};
    VoxelBitmap bitmap(box);
    Cells cells;
    const int runs = 4 + upTo(30);
    for (int n = 0; n < runs; ++n) {
      // Not more than a third of the height, so that gaps are left, but for some that fill columns.
      const int length = n % 9 == 8 ? height : upTo(height / 3), lo = -90 + upTo(height - length);
      const VoxelRun run = {-3 + upTo(2), 5 + upTo(3), lo, lo + length};
      bitmap.add(run);
      for (int k = run.lo; k <= run.hi; ++k) cells.insert({run.i, run.j, k});
    }
    Cells listed;
    const std::vector<VoxelRun> found = bitmap.runs();
    for (std::size_t n = 0; n < found.size(); ++n) {
      const VoxelRun& run = found[n];
      ASSERT_LE(run.lo, run.hi);
      for (int k = run.lo; k <= run.hi; ++k) EXPECT_TRUE(listed.insert({run.i, run.j, k}).second);
      if (n == 0) continue;
      const VoxelRun& before = found[n - 1];
      // In order, and with a gap between those of a column.
      EXPECT_LT(std::tuple(before.i, before.j, before.hi + 1), std::tuple(run.i, run.j, run.lo)) << height;
    }
    EXPECT_EQ(listed, cells) << height;
    for (int i = -3; i <= -1; ++i) {
      for (int j = 5; j <= 8; ++j) {
        for (int k = -90; k <= -90 + height; ++k) {
          const std::uint64_t window = bitmap.from(i, j, k);
          for (int bit = 0; bit < 64 && k + bit <= -90 + height; ++bit) {
            ASSERT_EQ((window >> bit & 1) != 0, cells.count({i, j, k + bit}) > 0) << i << " " << j << " " << k + bit;
          }
        }
      }
    }
  }
}

TEST(VoxelBitmap, KnowsItsSizeBeforeItIsMade) {
  EXPECT_EQ((VoxelBitmap::Box{{0, 0, 0}, {9, 19, 63}}.bits()), 10.0 * 20 * 64);
  EXPECT_EQ((VoxelBitmap::Box{{0, 0, 0}, {9, 19, 64}}.bits()), 10.0 * 20 * 128);
  // Boxes whose product is beyond 64 bits.
  EXPECT_GT((VoxelBitmap::Box{{-2000000000, -2000000000, -2000000000}, {2000000000, 2000000000, 2000000000}}.bits()),
            1e28);
}

}  // namespace
}  // namespace accessvdb::internal
