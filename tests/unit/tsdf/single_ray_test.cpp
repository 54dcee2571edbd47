// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One return, voxels counted by hand.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

TsdfParams fourVoxels() {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.04;
  return params;
}

struct Seen {
  int observed = 0, cleared = 0;
};
Seen countAround(const PackedMap& map, const openvdb::Coord& centre) {
  Seen seen;
  for (int i = -15; i <= 15; ++i) {
    for (int j = -15; j <= 15; ++j) {
      for (int k = -15; k <= 15; ++k) {
        const VoxelState state = map.at(centre.offsetBy(i, j, k));
        seen.observed += state.weight > 0 ? 1 : 0;
        seen.cleared += state.cleared ? 1 : 0;
      }
    }
  }
  return seen;
}

// tan^2 of the cone is 0.108: at |i| = 4 it holds j^2 + k^2 <= 1 (5 voxels), at 1..3 only the axis; the ball adds four
// voxels beside the return. 2*5 + 2 + 2 + 2 + 5 = 21. The band is 3..9 voxels ahead, 21 voxels of radius 2.5 each.
class AlongEveryAxis : public testing::TestWithParam<int> {};

TEST_P(AlongEveryAxis, UpdatesTheVoxelsCountedByHand) {
  const int axis = GetParam() / 2, sign = GetParam() % 2 == 0 ? 1 : -1;
  PackedMap map(fourVoxels());
  ScanIntegrator integrator(map);
  const Eigen::Vector3f p = Eigen::Vector3f::Zero();
  Eigen::Vector3f q = Eigen::Vector3f::Zero();
  q[axis] = 5.0f * static_cast<float>(sign);
  const IntegrationResult result = integrator.integrate({&p, 1}, {&q, 1});

  const Seen seen = countAround(map, openvdb::Coord(0, 0, 0));
  EXPECT_EQ(seen.observed, 21);
  EXPECT_EQ(seen.cleared, 7 * 21);
  EXPECT_EQ(result.counts.distance_updates, 21u);
  EXPECT_EQ(result.counts.cleared_updates, 7u * 21u);
  EXPECT_EQ(result.counts.newly_observed, 21u);
  EXPECT_EQ(map.observed_voxels, 21u);
  EXPECT_EQ(result.new_leaves, map.tree().leafCount());
  for (int i = -4; i <= 4; ++i) {
    openvdb::Coord ijk(0, 0, 0);
    ijk[axis] = sign * i;
    const VoxelState state = map.at(ijk);
    EXPECT_EQ(state.weight, 1u) << i;
    EXPECT_NEAR(state.distance_m, std::max(0, i) * 0.01, 0.04 / kSampleSteps) << i;
    EXPECT_EQ(state.cleared, i > 2) << i;
  }
}
INSTANTIATE_TEST_SUITE_P(Tsdf, AlongEveryAxis, testing::Range(0, 6));

TEST(SingleRay, PaperProfileFillsTheCubeAndClearsALine) {
  TsdfParams params = fourVoxels();
  params.region = UpdateRegion::FullCube;
  params.cleared_radius_voxels = 0;
  params.cleared_begin_tau = 1;
  PackedMap map(params);
  ScanIntegrator integrator(map);
  const Eigen::Vector3f p = Eigen::Vector3f::Zero(), q(5.0f, 0, 0);
  const IntegrationResult result = integrator.integrate({&p, 1}, {&q, 1});
  const Seen seen = countAround(map, openvdb::Coord(0, 0, 0));
  EXPECT_EQ(seen.observed, 9 * 9 * 9);
  // Samples at 4.5, 5, ... 9 voxels; 4.5 rounds up to 5.
  EXPECT_EQ(seen.cleared, 5);
  EXPECT_EQ(result.counts.cleared_updates, 5u);
  for (int i = 5; i <= 9; ++i) EXPECT_TRUE(map.at(openvdb::Coord(i, 0, 0)).cleared) << i;
}

TEST(SingleRay, BandEndsAtTheSensor) {
  PackedMap map(fourVoxels());
  ScanIntegrator integrator(map);
  const Eigen::Vector3f p = Eigen::Vector3f::Zero(), q(0.05f, 0, 0);  // 5 voxels away; the band would reach 9
  integrator.integrate({&p, 1}, {&q, 1});
  EXPECT_EQ(countAround(map, openvdb::Coord(0, 0, 0)).cleared, 3 * 21);
  EXPECT_FALSE(map.at(openvdb::Coord(6, 0, 0)).cleared);
}

TEST(SingleRay, EmptyScanChangesNothing) {
  PackedMap map(fourVoxels());
  ScanIntegrator integrator(map);
  const Eigen::Vector3f q(1, 0, 0);
  const IntegrationResult result = integrator.integrate({}, {&q, 1});
  EXPECT_EQ(result.touched_leaves, 0u);
  EXPECT_EQ(map.tree().leafCount(), 0u);
}

}  // namespace
}  // namespace accessvdb::internal
