// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of several tools stands for a point.
#include "field/tools/best_tool.h"

#include <gtest/gtest.h>

#include <vector>

namespace accessvdb::internal {
namespace {

ToolVerdict reaches(std::uint16_t score = 0) { return {PointLabel::Accessible, PointReason::None, score, 10}; }
ToolVerdict stopped(PointReason reason) { return {PointLabel::Blocked, reason, kNoScore, 10}; }
ToolVerdict collides(std::uint16_t score, std::uint16_t limit) {
  return {PointLabel::Blocked, PointReason::Tool, score, limit};
}
std::size_t best(const std::vector<ToolVerdict>& tools) { return bestTool(tools); }

TEST(BestTool, IsTheFirstThatReaches) {
  EXPECT_EQ(best({reaches()}), 0u);
  EXPECT_EQ(best({stopped(PointReason::Arm), reaches(9), reaches(0)}), 1u);
  EXPECT_EQ(best({collides(11, 10), stopped(PointReason::Normal), reaches(9)}), 2u);
}

TEST(BestTool, IsElseTheOneThatCameFarthest) {
  // In the order of the stages; the two reasons of the corridor are one.
  EXPECT_EQ(best({stopped(PointReason::Normal), stopped(PointReason::Unseen)}), 1u);
  EXPECT_EQ(best({stopped(PointReason::Unseen), stopped(PointReason::Unknown)}), 1u);
  EXPECT_EQ(best({stopped(PointReason::Unseen), stopped(PointReason::Arm)}), 1u);
  EXPECT_EQ(best({stopped(PointReason::Unknown), stopped(PointReason::Arm)}), 0u);
  EXPECT_EQ(best({stopped(PointReason::Arm), stopped(PointReason::Unknown)}), 0u);
  EXPECT_EQ(best({stopped(PointReason::Arm), collides(65534, 1)}), 1u);
}

TEST(BestTool, ComparesCollisionsAsMultiplesOfTheLimits) {
  EXPECT_EQ(best({collides(30, 10), collides(200, 100)}), 1u);  // 3 times against 2 times
  EXPECT_EQ(best({collides(20, 10), collides(200, 100)}), 0u);  // equal: the order
  EXPECT_EQ(best({collides(21, 10), collides(200, 100)}), 1u);
  EXPECT_EQ(best({collides(11, 10), collides(2, 1)}), 0u);
  // The largest that there are: the product has 32 bits.
  EXPECT_EQ(best({collides(65534, 65533), collides(65533, 65534)}), 1u);
  EXPECT_EQ(best({collides(65533, 65534), collides(65534, 65533)}), 0u);
}

TEST(BestTool, IsTheFirstWhereNothingIsKnown) {
  const ToolVerdict unscored = {PointLabel::Unscored, PointReason::Confidence, kNoScore, 10};
  EXPECT_EQ(best({unscored, unscored}), 0u);
}

/// Else a point would be told as blocked that a tool may reach.
TEST(BestTool, IsOneThatMayYetReachBeforeOneThatDoesNot) {
  const ToolVerdict waits = {PointLabel::Unscored, PointReason::Confidence, kNoScore, 10};
  EXPECT_EQ(best({waits, collides(11, 10)}), 0u);
  EXPECT_EQ(best({collides(11, 10), stopped(PointReason::Arm), waits, collides(1, 1), waits}), 2u);
  EXPECT_EQ(best({collides(11, 10), waits, reaches(9)}), 2u);
  EXPECT_EQ(best({reaches(9), waits}), 0u);
}

TEST(PointOfTools, HasABitForEachThatReaches) {
  std::vector<SurfacePoint> tools(32);
  for (SurfacePoint& point : tools) point.label = PointLabel::Blocked;
  std::vector<ToolTraits> traits;
  for (std::uint8_t family = 0; family < 32; ++family) traits.push_back({10, family, 0});
  EXPECT_EQ(pointOfTools(tools, traits).tools, 0u);
  tools[31].label = PointLabel::Accessible;
  tools[31].score = 7;
  const SurfacePoint point = pointOfTools(tools, traits);
  EXPECT_EQ(point.tool, 31);
  EXPECT_EQ(point.tools, 0x80000000u);
  EXPECT_EQ(point.score, 7);
}

}  // namespace
}  // namespace accessvdb::internal
