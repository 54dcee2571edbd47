// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Names and windows of tiles; which tiles need a return, against trying all of them.
#include <gtest/gtest.h>

#include <random>

#include "accessvdb/error.h"
#include "accessvdb/tiles.h"
#include "tiles/tile_grid.h"

namespace accessvdb::tiles {
namespace {

constexpr std::int32_t kInt32Min = std::numeric_limits<std::int32_t>::min();
constexpr std::int32_t kInt32Max = std::numeric_limits<std::int32_t>::max();

TEST(TileId, NamesAreReadBack) {
  for (const TileId& id : {TileId{0, 0, ""}, TileId{3, -2, ""}, TileId{-1, -1, "0"}, TileId{7, 8, "0123"},
                           TileId{kInt32Min, kInt32Max, "3"}}) {
    EXPECT_EQ(TileId::parse(id.name()), id) << id.name();
  }
  EXPECT_EQ((TileId{3, -2, "01"}).name(), "3_-2.01");
}

TEST(TileId, NothingElseIsAName) {
  for (const std::string name : {"",
                                 "_",
                                 "1",
                                 "1_",
                                 "_1",
                                 "1_1.",
                                 "1_1.4",
                                 "1_1.9",
                                 "1_1.0x",
                                 "1_1.0.1",
                                 "01_1",
                                 "1_01",
                                 "+1_1",
                                 "1_+1",
                                 "-0_1",
                                 " 1_1",
                                 "1_1 ",
                                 "1 _1",
                                 "1__1",
                                 "1_1_1",
                                 "../x",
                                 "../1_1",
                                 "1_1/..",
                                 "1_1.0/../..",
                                 "0x1_1",
                                 "1.0_1",
                                 "2147483648_0",
                                 "0_-2147483649",
                                 "99999999999999999999_0",
                                 "1_1\n",
                                 ".1_1",
                                 "tiles/1_1"}) {
    try {
      const TileId id = TileId::parse(name);
      ADD_FAILURE() << "\"" << name << "\" was read as " << id.name();
    } catch (const InvalidArgument& error) {
      EXPECT_EQ(error.id(), "usage.tile") << name;
    }
  }
  EXPECT_THROW((void)TileId::parse(std::string("1_1\0", 4)), InvalidArgument);
}

/// Each voxel of the whole is in exactly one of the quarters, at any depth.
TEST(TileId, QuartersShareTheWhole) {
  constexpr std::int32_t kEdge = 512;
  std::mt19937 random(3);
  for (const TileId& id : {TileId{0, 0, ""}, TileId{-3, 5, ""}, TileId{2, -1, "2"}}) {
    const FieldWindow whole = id.window(kEdge);
    const std::int32_t edge = kEdge >> id.quarters.size();
    EXPECT_EQ(whole.core_high[0] - whole.core_low[0], edge);
    EXPECT_EQ(whole.core_high[1] - whole.core_low[1], edge);
    const auto quarters = id.split();
    for (int n = 0; n < 1000; ++n) {
      const std::int32_t i = whole.core_low[0] + static_cast<std::int32_t>(random() % static_cast<unsigned>(edge));
      const std::int32_t j = whole.core_low[1] + static_cast<std::int32_t>(random() % static_cast<unsigned>(edge));
      const int expected =
          (2 * (i - whole.core_low[0]) >= edge ? 1 : 0) + (2 * (j - whole.core_low[1]) >= edge ? 2 : 0);
      for (int q = 0; q < 4; ++q) {
        const FieldWindow part = quarters[static_cast<std::size_t>(q)].window(kEdge);
        const bool in =
            part.core_low[0] <= i && i < part.core_high[0] && part.core_low[1] <= j && j < part.core_high[1];
        EXPECT_EQ(in, q == expected) << quarters[static_cast<std::size_t>(q)].name() << " " << i << " " << j;
      }
    }
    for (const TileId& quarter : quarters) EXPECT_EQ(quarter.whole(), id.whole());
  }
  EXPECT_EQ((TileId{-1, 2, ""}).window(128).core_low, (std::array<std::int32_t, 2>{-128, 256}));
}

TEST(TileGrid, NamesTheTilesWhoseMarginHoldsAReturn) {
  for (const std::int32_t margin : {0, 1, 38, 64}) {
    constexpr std::int32_t kEdge = 128;
    const TileGrid grid(kEdge, margin);
    for (std::int32_t i = -300; i <= 300; ++i) {
      const TileRange range = grid.around(i, -i);
      for (std::int32_t tile = -5; tile <= 5; ++tile) {
        const bool near = kEdge * tile - margin <= i && i < kEdge * (tile + 1) + margin;
        EXPECT_EQ(range.x_low <= tile && tile <= range.x_high, near) << i << " " << tile << " " << margin;
        const bool near_y = kEdge * tile - margin <= -i && -i < kEdge * (tile + 1) + margin;
        EXPECT_EQ(range.y_low <= tile && tile <= range.y_high, near_y) << -i << " " << tile << " " << margin;
      }
    }
  }
}

}  // namespace
}  // namespace accessvdb::tiles
