// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is known to be blocked stays true: against plain counts of colliding voxels, a direction is only kept as
/// blocked while it really is. Also tests the tables used for this, and the memory per point.
#include "update/known_blocked.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "unit/points/random_points.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {
namespace {

using test::Random;

constexpr int kDirections = 20;
constexpr std::uint16_t kLimit = 3;

/// A random tool: its voxels as plain sets, and as columns.
struct RandomTool {
  std::array<std::set<Index3>, kDirections> voxels;
  std::vector<kernels::VoxelColumn> columns;
  std::vector<std::uint32_t> begin = {0};

  explicit RandomTool(Random& random) {
    for (auto& of_direction : voxels) {
      std::map<std::array<std::int16_t, 3>, std::uint64_t> runs;
      for (int n = 0; n < 40; ++n) {
        const auto x = static_cast<std::int16_t>(random.between(-6, 6));
        const auto y = static_cast<std::int16_t>(random.between(-6, 6));
        const int z = random.between(0, 63);
        runs[{x, y, -20}] |= std::uint64_t{1} << z;
        of_direction.insert({x, y, z - 20});
      }
      for (const auto& [at, bits] : runs) columns.push_back({at[0], at[1], at[2], 0, bits});
      begin.push_back(static_cast<std::uint32_t>(columns.size()));
    }
  }
  [[nodiscard]] kernels::ToolKernelView view() const {
    kernels::ToolKernelView view;
    view.columns = columns.data();
    view.column_begin = begin.data();
    view.collision_limit = kLimit;
    return view;
  }
};

TEST(OffsetDirections, AreTheVoxelsReadBackwards) {
  Random random(1);
  const RandomTool tool(random);
  const OffsetDirections table(tool.view(), kDirections, 1 << 24);
  ASSERT_FALSE(table.empty());
  for (std::int32_t x = -8; x <= 8; ++x) {
    for (std::int32_t y = -8; y <= 8; ++y) {
      for (std::int32_t z = -24; z <= 46; ++z) {
        const std::uint64_t* entry = table.at({x, y, z});
        for (int d = 0; d < kDirections; ++d) {
          const bool listed = entry != nullptr && (entry[d >> 6] >> (d & 63) & 1) != 0;
          ASSERT_EQ(listed, tool.voxels[static_cast<std::size_t>(d)].contains({x, y, z})) << x << " " << y << " " << z;
        }
      }
    }
  }
}

TEST(OffsetDirections, StayEmptyWhereTheyWouldBeTooLarge) {
  Random random(2);
  const RandomTool tool(random);
  EXPECT_TRUE(OffsetDirections(tool.view(), kDirections, 1000).empty());
}

TEST(FreedVoxels, AreFoundInAnyBox) {
  Random random(3);
  FlipSet flips;
  std::set<Index3> all;
  for (int n = 0; n < 300; ++n) {
    const Index3 v = {random.between(-150, 150), random.between(-150, 150), random.between(-150, 150)};
    LeafChange change;
    change.origin_ijk = {v[0] & ~7, v[1] & ~7, v[2] & ~7};
    change.collides_off[static_cast<std::size_t>(v[0] & 7)] = std::uint64_t{1} << ((v[1] & 7) * 8 + (v[2] & 7));
    flips.add({&change, 1});
    all.insert(v);
  }
  const FreedVoxels freed(flips);
  for (int n = 0; n < 50; ++n) {
    Index3 low, high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = random.between(-160, 100);
      high[axis] = low[axis] + random.between(0, 150);
    }
    std::vector<Index3> found;
    freed.collect(low, high, found);
    std::sort(found.begin(), found.end());
    std::vector<Index3> expected;
    for (const Index3& v : all) {
      if (v[0] >= low[0] && v[0] <= high[0] && v[1] >= low[1] && v[1] <= high[1] && v[2] >= low[2] && v[2] <= high[2]) {
        expected.push_back(v);
      }
    }
    ASSERT_EQ(found, expected);
  }
}

/// Directions lose colliding voxels over many updates; each is tested again only if release() says so.
TEST(KnownBlocked, NeverKeepsADirectionThatHasBecomeFree) {
  Random random(4);
  int kept = 0, released = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const RandomTool tool(random);
    const OffsetDirections table(tool.view(), kDirections, 1 << 24);
    const Index3 point = {random.between(-50, 50), random.between(-50, 50), random.between(-50, 50)};
    std::set<Index3> colliding;  // relative to the point
    for (const auto& voxels : tool.voxels) {
      for (const Index3& v : voxels) {
        if (random.below(3) == 0) colliding.insert(v);
      }
    }
    const auto countOf = [&](int d) {
      const auto& voxels = tool.voxels[static_cast<std::size_t>(d)];
      return static_cast<int>(
          std::count_if(voxels.begin(), voxels.end(), [&](const Index3& v) { return colliding.contains(v); }));
    };
    KnownBlocked known;
    kernels::ScoreResult learnt;
    for (int d = 0; d < kDirections; ++d) {
      if (countOf(d) < kLimit) continue;
      learnt.tool_blocked.set(d);
      learnt.least_blocked = static_cast<std::uint16_t>(std::min<int>(learnt.least_blocked, countOf(d)));
    }
    known.learn(learnt, kLimit);
    while (!colliding.empty()) {
      std::vector<Index3> flips;
      for (int n = random.between(1, 6); n > 0 && !colliding.empty(); --n) {
        auto it = colliding.begin();
        std::advance(it, random.below(static_cast<std::int32_t>(colliding.size())));
        flips.push_back({(*it)[0] + point[0], (*it)[1] + point[1], (*it)[2] + point[2]});
        colliding.erase(it);
      }
      const DirectionMask before = known.tool;
      const DirectionMask better = known.release(point, flips, table);
      for (int d = 0; d < kDirections; ++d) {
        if (known.tool.test(d)) {
          ASSERT_GE(countOf(d), kLimit + known.margin) << "trial " << trial << " direction " << d;
          ++kept;
        } else if (before.test(d)) {
          ASSERT_TRUE(better.test(d));
          ++released;
        }
      }
    }
  }
  EXPECT_GT(kept, 1000);  // otherwise nothing was saved
  EXPECT_GT(released, 500);
}

/// docs/DESIGN.md, "Points", gives these numbers.
TEST(HostBytes, APoint) {
  EXPECT_EQ(sizeof(PointRecord), 56u);
  EXPECT_EQ(sizeof(KnownBlocked), 72u);
  Random random(5);
  PointStore store(test::pointParams(0.05, 180), test::directionTable(180));
  const Eigen::Vector3f q_L(0, 0, 5);
  std::vector<Eigen::Vector3f> points;
  for (int n = 0; n < 40000; ++n) {  // a surface, as seen by scans
    points.emplace_back(static_cast<float>(random.uniform(-5, 5)), static_cast<float>(random.uniform(-5, 5)), 0.0f);
  }
  store.addReturns(points, {&q_L, 1});
  const double bytes = static_cast<double>(store.bytes()) / store.size();
  EXPECT_GE(bytes, 100.0);             // 12 + 12 + 24 + 24 + 4 + 24 without any slack
  EXPECT_LE(bytes, 2 * 100.0 + 40.0);  // vectors grow by doubling; the index on top
}

}  // namespace
}  // namespace accessvdb::internal
