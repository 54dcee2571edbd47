// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The brute-force oracles against hand-computed cases.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "support/brute_force_field.h"
#include "support/brute_force_tsdf.h"

namespace accessvdb::test {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

// One return at the origin, sensor 2 m away on +x, v = 0.1. tau is a little more than 4 v, so that the ends of the box
// and of the cleared band fall between voxels: x/v in -4..4, cleared from 2.05 to 9.2 voxels.
BruteForceTsdf oneReturn() {
  BruteForceTsdf tsdf({.voxel_size_m = 0.1, .tau_m = 0.41});
  const Vector3d p(0, 0, 0), q(2, 0, 0);
  tsdf.integrate({&p, 1}, {&q, 1});
  return tsdf;
}

TEST(BruteForceTsdf, OneReturnUpdatesTheDoubleCone) {
  const BruteForceTsdf tsdf = oneReturn();
  for (int i = -4; i <= 4; ++i) {
    EXPECT_TRUE(tsdf({i, 0, 0}).observed) << i;
    EXPECT_NEAR(tsdf({i, 0, 0}).distance_m, std::max(0.0, 0.1 * i), 1e-6) << i;
  }
  EXPECT_FALSE(tsdf({5, 0, 0}).observed);
  EXPECT_FALSE(tsdf({-5, 0, 0}).observed);
  EXPECT_TRUE(tsdf({4, 1, 0}).observed);   // 4/sqrt(17) = 0.970
  EXPECT_FALSE(tsdf({3, 1, 0}).observed);  // 3/sqrt(10) = 0.9487
  EXPECT_FALSE(tsdf({4, 1, 1}).observed);  // 4/sqrt(18) = 0.943
  EXPECT_FALSE(tsdf({1, 1, 0}).observed);
  EXPECT_NEAR(tsdf({4, 1, 0}).distance_m, 2.0 - std::hypot(1.6, 0.1), 1e-6);
  EXPECT_EQ(tsdf({4, 1, 0}).weight, 1u);

  // 9 on the axis, 4 around each end; and the 4 beside the return, exactly v away: a tie, reported as such.
  int sure = 0;
  for (const auto& [voxel, state] : tsdf.voxels()) {
    if (state.count > 0 && state.update_margin_m > 1e-9) ++sure;
  }
  EXPECT_EQ(sure, 9 + 8);
  EXPECT_LT(tsdf.voxels().at({0, 1, 0}).update_margin_m, 1e-9);
  EXPECT_NEAR(tsdf.voxels().at({3, 1, 0}).update_margin_m, 0.1 * (0.95 * std::sqrt(10.0) - 3.0), 1e-12);
}

TEST(BruteForceTsdf, OneReturnClearsAThickBand) {
  const BruteForceTsdf tsdf = oneReturn();
  int cleared = 0;
  for (const auto& [voxel, state] : tsdf.voxels()) {
    if (!state.cleared) continue;
    ++cleared;
    EXPECT_GT(state.cleared_depth_m, 0.0);
    EXPECT_GE(voxel[0], 3);
    EXPECT_LE(voxel[0], 9);
    EXPECT_LE(voxel[1] * voxel[1] + voxel[2] * voxel[2], 6);
  }
  EXPECT_EQ(cleared, 7 * 21);  // 21 grid points in a disc of radius 2.5
  EXPECT_TRUE(tsdf({9, 2, 1}).cleared);
  EXPECT_FALSE(tsdf({2, 0, 0}).cleared);
  EXPECT_FALSE(tsdf({9, 2, 2}).cleared);
  EXPECT_FALSE(tsdf({10, 0, 0}).cleared);
}

TEST(BruteForceTsdf, ClearsNothingBehindTheSensorAndAveragesOverReturns) {
  BruteForceTsdf tsdf({.voxel_size_m = 0.1, .tau_m = 0.41});
  const std::vector<Vector3d> points = {{0, 0, 0}, {0.06, 0, 0}};
  const std::vector<Vector3d> sensors = {{0.55, 0, 0}, {0.55, 0, 0}};
  tsdf.integrate(points, sensors);
  EXPECT_TRUE(tsdf({5, 0, 0}).cleared);
  EXPECT_FALSE(tsdf({6, 0, 0}).cleared);
  EXPECT_EQ(tsdf({2, 0, 0}).weight, 2u);
  EXPECT_NEAR(tsdf({2, 0, 0}).distance_m, 0.5 * (0.20 + 0.14), 1e-6);
}

constexpr int kDirections = 8;  // every 45 degrees: 0, 1 and 7 are within 70 degrees of +x

/// A wall x = 0 of 3 x 3 points, seen from +x; the space in front of it cleared; a tool of four voxels along the
/// direction.
BruteForceInput wall() {
  auto map = std::make_shared<DenseMap>(VoxelCoord{-2, -15, -5}, VoxelCoord{15, 15, 5});
  BruteForceInput input;
  input.voxel_size_m = 0.1;
  input.collision_distance_m = 0.05f;
  input.num_directions = kDirections;
  input.arm_distances_m = {0.24, 0.5, 0.9};
  input.neighbours = 9;
  for (int j = -15; j <= 15; ++j)
    for (int k = -5; k <= 5; ++k)
      for (int i = 0; i <= 15; ++i) {
        MapVoxel& voxel = map->at({i, j, k});
        if (i == 0)
          voxel = {true, 0.0f, 5, false};
        else
          voxel.cleared = true;
      }
  for (int j = -1; j <= 1; ++j)
    for (int k = -1; k <= 1; ++k) {
      BruteForcePoint point;
      point.id = static_cast<std::uint32_t>(input.points.size());
      point.voxel = {0, j, k};
      point.first_position_L = point.mean_position_L =
          Vector3f(0.0f, 0.1f * static_cast<float>(j), 0.1f * static_cast<float>(k));
      point.mean_sensor_L = Vector3d(5, 0, 0);
      point.seen.assign(kDirections, true);
      input.points.push_back(point);
    }
  const int dx[kDirections] = {1, 1, 0, -1, -1, -1, 0, 1}, dy[kDirections] = {0, 1, 1, 1, 0, -1, -1, -1};
  for (int d = 0; d < kDirections; ++d) {
    input.tool_voxels.push_back({});
    for (int r = 3; r <= 6; ++r) input.tool_voxels.back().push_back({r * dx[d], r * dy[d], 0});
  }
  input.map = [map](const VoxelCoord& c) { return (*map)(c); };
  return input;
}

/// The same input with some voxels of the map replaced.
BruteForceInput with(BruteForceInput input, std::vector<std::pair<VoxelCoord, MapVoxel>> changes) {
  input.map = [below = input.map, changes](const VoxelCoord& c) {
    for (const auto& [voxel, value] : changes) {
      if (voxel == c) return value;
    }
    return below(c);
  };
  return input;
}

constexpr std::size_t kCentre = 4;
const MapVoxel kObstacle{true, 0.0f, 5, true};

BruteForceResult centre(const BruteForceInput& input) { return bruteForceScore(input)[kCentre]; }

TEST(BruteForceField, FreeWallIsAccessibleAlongItsNormal) {
  const BruteForceResult result = centre(wall());
  EXPECT_EQ(result.label, PointLabel::Accessible);
  EXPECT_EQ(result.reason, PointReason::None);
  EXPECT_EQ(result.score, 0);
  EXPECT_EQ(result.direction, 0);
  EXPECT_TRUE(result.normal.isApprox(Vector3f(1, 0, 0)));
  EXPECT_NEAR(result.pca_gap, 1.0, 1e-9);  // a square patch
  EXPECT_EQ(result.weight, 5u);
  EXPECT_EQ(result.confidence, 0.5);
  EXPECT_EQ(result.neighbours.size(), 9u);
  EXPECT_EQ(result.neighbours[0], kCentre);
  EXPECT_EQ(result.neighbours[1], 1u);  // the four at 0.1 m by id: 1, 3, 5, 7
}

TEST(BruteForceField, NormalTurnsToTheSensor) {
  BruteForceInput input = wall();
  input.points[kCentre].mean_sensor_L = Vector3d(-5, 0, 0);
  EXPECT_TRUE(centre(input).normal.isApprox(Vector3f(-1, 0, 0)));
  EXPECT_EQ(centre(input).pca_side, 1.0);
}

TEST(BruteForceField, ToolCollisionsAgainstTheLimit) {
  // One voxel of the tool on +x, none on a sample of its arm (voxels 2, 5, 9); the diagonals lose their arm at once.
  const BruteForceInput base = with(wall(), {{{4, 0, 0}, kObstacle}, {{2, 2, 0}, kObstacle}, {{2, -2, 0}, kObstacle}});
  BruteForceInput input = base;
  input.collision_limit = 1;
  BruteForceResult result = centre(input);
  EXPECT_EQ(result.label, PointLabel::Blocked);
  EXPECT_EQ(result.reason, PointReason::Tool);
  EXPECT_EQ(result.score, 1);
  EXPECT_EQ(result.direction, 0);
  input.collision_limit = 2;
  result = centre(input);
  EXPECT_EQ(result.label, PointLabel::Accessible);
  EXPECT_EQ(result.score, 1);

  // Free diagonals: the lower count wins over the smaller angle, and the lower d over its equal.
  result = centre(with(wall(), {{{4, 0, 0}, kObstacle}}));
  EXPECT_EQ(result.label, PointLabel::Accessible);
  EXPECT_EQ(result.score, 0);
  EXPECT_EQ(result.direction, 1);
}

TEST(BruteForceField, PrefersTheDirectionNearestToTheNormalInsideTheCone) {
  BruteForceInput input = wall();
  // 40 degrees of yaw: 45 degrees (d = 1) is nearest, 0 (d = 0) and 90 (d = 2) are inside, 315 (d = 7) is 85 away.
  const float yaw = 40.0f * std::numbers::pi_v<float> / 180.0f;
  input.points[kCentre].given_normal = Vector3f(std::cos(yaw), std::sin(yaw), 0.0f);
  EXPECT_EQ(centre(input).direction, 1);
  for (BruteForcePoint& point : input.points) {
    point.seen.assign(kDirections, false);
    point.seen[7] = true;
  }
  EXPECT_EQ(centre(input).reason, PointReason::Unseen);
  input.points[kCentre].seen[0] = true;
  EXPECT_EQ(centre(input).direction, 0);
}

TEST(BruteForceField, DistanceAtTheThresholdIsFree) {
  const float r_c = wall().collision_distance_m;
  const auto score = [](float distance) {
    const MapVoxel voxel{true, distance, 1, false};
    return centre(with(wall(), {{{4, 0, 0}, voxel}, {{2, 2, 0}, kObstacle}, {{2, -2, 0}, kObstacle}})).score;
  };
  EXPECT_EQ(score(r_c), 0);
  EXPECT_EQ(score(std::nextafter(r_c, 0.0f)), 1);
  EXPECT_EQ(score(std::nanf("")), 1);  // never accessible through bad data
}

TEST(BruteForceField, ArmRanksByTheSamplesPassed) {
  // +x fails at its second sample, the diagonals (voxels 2, 4, 6 of both axes) at their first.
  const std::vector<std::pair<VoxelCoord, MapVoxel>> diagonals = {{{2, 2, 0}, kObstacle}, {{2, -2, 0}, kObstacle}};
  auto changes = diagonals;
  changes.push_back({{5, 0, 0}, kObstacle});
  BruteForceResult result = centre(with(wall(), changes));
  EXPECT_EQ(result.label, PointLabel::Blocked);
  EXPECT_EQ(result.reason, PointReason::Arm);
  EXPECT_EQ(result.direction, 0);
  EXPECT_EQ(result.score, kNoScore);

  changes = diagonals;
  changes.push_back({{5, 0, 0}, MapVoxel{}});  // neither observed nor cleared
  result = centre(with(wall(), changes));
  EXPECT_EQ(result.reason, PointReason::Unknown);
  EXPECT_EQ(result.direction, 0);

  // One diagonal gets further than +x.
  changes = {{{2, 0, 0}, kObstacle}, {{2, 2, 0}, kObstacle}, {{4, -4, 0}, MapVoxel{}}};
  result = centre(with(wall(), changes));
  EXPECT_EQ(result.reason, PointReason::Unknown);
  EXPECT_EQ(result.direction, 7);

  // Observed free space needs no cleared flag.
  EXPECT_EQ(centre(with(wall(), {{{5, 0, 0}, MapVoxel{true, 0.2f, 1, false}}})).direction, 0);
}

TEST(BruteForceField, SeenDirectionsAreJoinedWithTheNeighbours) {
  BruteForceInput input = wall();
  for (BruteForcePoint& point : input.points) point.seen.assign(kDirections, false);
  BruteForceResult result = centre(input);
  EXPECT_EQ(result.label, PointLabel::Blocked);
  EXPECT_EQ(result.reason, PointReason::Unseen);
  EXPECT_EQ(result.direction, kNoDirection);

  input.points[0].seen[7] = true;
  EXPECT_EQ(centre(input).direction, 7);
  EXPECT_EQ(centre(input).label, PointLabel::Accessible);
  input.join_neighbour_views = false;
  EXPECT_EQ(centre(input).reason, PointReason::Unseen);
  input.points[kCentre].seen[1] = true;
  EXPECT_EQ(centre(input).direction, 1);
}

TEST(BruteForceField, NoNormalAndNoDirection) {
  BruteForceInput input = wall();
  input.points[kCentre].given_normal = Vector3f(0, 0, 1);
  BruteForceResult result = centre(input);
  EXPECT_EQ(result.label, PointLabel::Blocked);
  EXPECT_EQ(result.reason, PointReason::Normal);
  EXPECT_EQ(result.direction, kNoDirection);
  EXPECT_EQ(result.score, kNoScore);

  // The ball has a radius of 10 v = 1 m: with all others beyond it there is no normal at all.
  input = wall();
  for (std::size_t i = 0; i < input.points.size(); ++i) {
    if (i != kCentre && i != 0) input.points[i].mean_position_L.x() = 2.0f;
  }
  result = centre(input);
  EXPECT_EQ(result.label, PointLabel::Unscored);
  EXPECT_EQ(result.reason, PointReason::Normal);
  EXPECT_EQ(result.neighbours.size(), 2u);
}

TEST(BruteForceField, ConfidenceComesFirst) {
  const auto weigh = [](std::uint32_t own, std::uint32_t beside) {
    BruteForceInput input = wall();
    input.map = [below = input.map, own, beside](const VoxelCoord& c) {
      MapVoxel voxel = below(c);
      if (voxel.observed) voxel.weight = c == VoxelCoord{0, 0, 0} ? own : c == VoxelCoord{0, 1, -1} ? beside : 0;
      return voxel;
    };
    return input;
  };
  EXPECT_EQ(centre(weigh(1, 1)).label, PointLabel::Unscored);  // 1/6 < 0.2
  EXPECT_EQ(centre(weigh(1, 1)).reason, PointReason::Confidence);
  EXPECT_EQ(centre(weigh(1, 2)).label, PointLabel::Accessible);  // 2/7, from the voxel beside it
  EXPECT_EQ(centre(weigh(1, 2)).weight, 2u);
  BruteForceInput own_only = weigh(1, 2);
  own_only.neighbourhood_weight = false;
  EXPECT_EQ(centre(own_only).reason, PointReason::Confidence);
  BruteForceInput also_no_normal = weigh(1, 1);
  for (BruteForcePoint& point : also_no_normal.points) point.given_normal = Vector3f(0, 0, 1);
  EXPECT_EQ(centre(also_no_normal).reason, PointReason::Confidence);
}

}  // namespace
}  // namespace accessvdb::test
