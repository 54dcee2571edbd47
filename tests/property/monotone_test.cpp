// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// More obstacles, less known space or more tool can only take access away.
#include <gtest/gtest.h>

#include "support/determinism_support.h"
#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

TEST(Monotone, ObstaclesNeverGiveAccess) {
  std::mt19937_64 random(1);
  constexpr int kDirections = 36;
  const ApproachFixture approach(kDirections, {2.4, 5.0, 9.0});
  int lost = 0, free_cases = 0;
  for (int scene = 0; scene < 500; ++scene) {
    OccupancyFixture map;
    map.freeArm({-12, -12, -1}, {12, 12, 1});
    ToolFixture tool;
    for (int d = 0; d < kDirections; ++d) {
      for (int c = 0; c < 10; ++c) {
        tool.columns.push_back(column(below(random, 30) - 15, below(random, 30) - 15, below(random, 20) - 10,
                                      random() >> below(random, 64)));
      }
      tool.endDirection();
    }
    const double yaw = uniform(random, 0, 6.3);
    const float normal[3] = {static_cast<float>(std::cos(yaw)), static_cast<float>(std::sin(yaw)), 0};
    const float position[3] = {static_cast<float>(uniform(random, -1, 1)), static_cast<float>(uniform(random, -1, 1)),
                               0};
    const std::uint64_t seen[1] = {random() & random()};
    kernels::ScoreItem item;
    for (int d = 0; d < kDirections; ++d) item.candidates.set(d);
    const int limit = 1 + below(random, 15);
    bool accessible = true;
    std::uint16_t score = 0;
    for (int step = 0; step < 20; ++step) {
      const auto result =
          kernels::searchDirections(map.reader(), 1.0f, tool.view(limit), approach.view, position, normal, seen, item);
      const bool now = result.reason == PointReason::None;
      ASSERT_TRUE(accessible || !now) << "scene " << scene << " step " << step;
      if (step > 0) {
        ASSERT_GE(result.score, score);
      }
      lost += accessible && !now && step > 0 ? 1 : 0;
      free_cases += now ? 1 : 0;
      accessible = now;
      score = result.score;
      for (int n = 0; n < 500; ++n)
        map.collide({below(random, 40) - 20, below(random, 40) - 20, below(random, 60) - 20});
      for (int n = 0; n < 40; ++n) map.blockArm({below(random, 25) - 12, below(random, 25) - 12, below(random, 3) - 1});
    }
  }
  EXPECT_GT(lost, 100);
  EXPECT_GT(free_cases, 500);
}

/// The same scans, one tool inside the other, the same number of collisions allowed.
TEST(Monotone, AFatterToolNeverGivesAccess) {
  std::size_t lost = 0, kept = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const std::vector<Scan> scans = wallScans(seed, 4, 700);
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.scoring.max_collisions = seed % 2 == 0 ? 8 : 1;
    const auto fieldOf = [&](const ToolGeometry& tool) {
      AccessibilityField field(tool, params);
      for (const Scan& scan : scans) {
        field.integrateScan(scan.points_S, scan.T_W_S);
        field.update();
      }
      return field.snapshot();
    };
    const FieldSnapshot slim = fieldOf(boxTool({0.0f, -0.02f, -0.02f}, {0.7f, 0.02f, 0.05f}));
    for (const ToolGeometry& tool :
         {boxTool({0.0f, -0.05f, -0.02f}, {0.7f, 0.06f, 0.2f}), boxTool({-0.05f, -0.2f, -0.3f}, {1.1f, 0.2f, 0.4f})}) {
      const FieldSnapshot fat = fieldOf(tool);
      ASSERT_EQ(slim.points.size(), fat.points.size());
      for (std::size_t n = 0; n < slim.points.size(); ++n) {
        const bool slim_free = slim.points[n].label == PointLabel::Accessible,
                   fat_free = fat.points[n].label == PointLabel::Accessible;
        ASSERT_TRUE(slim_free || !fat_free) << n;
        if (fat_free) {
          ASSERT_GE(fat.points[n].score, slim.points[n].score);
        }
        lost += slim_free && !fat_free ? 1 : 0;
        kept += fat_free ? 1 : 0;
      }
    }
  }
  EXPECT_GT(lost, 100u);
  EXPECT_GT(kept, 100u);
}

}  // namespace
}  // namespace accessvdb::test
