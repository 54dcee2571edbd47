// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Scans against the plain loops of loop_tsdf.h: weights exactly, distances within one step of a sample.
///
/// Tolerance: a sample is rounded to its nearest step (half a step), each fold rounds the mean to a sixteenth of a
/// step, and float32 evaluates a distance to about 1e-6 voxel, a hundredth of a step. So three scans stay below one
/// step.
#include <gtest/gtest.h>

#include <vector>

#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

/// Decisions closer than this many voxels to their border may go either way in float32.
constexpr double kMargin = 1e-4;

void expectEqualMaps(const PackedMap& map, const test::LoopTsdf& loops) {
  const TsdfParams& params = map.params();
  const double step_m = (params.truncation_distance_m - params.clamp_min_m) / kSampleSteps;
  std::size_t compared = 0, left_out = 0, observed = 0, cleared = 0;
  for (const auto& [ijk, expected] : loops.voxels) {
    const VoxelState state = map.at(openvdb::Coord(ijk[0], ijk[1], ijk[2]));
    if (expected.update_margin < kMargin) {
      ++left_out;
    } else {
      ++compared;
      ASSERT_EQ(state.weight, expected.count) << ijk[0] << ' ' << ijk[1] << ' ' << ijk[2];
      if (expected.count > 0) {
        ++observed;
        ASSERT_NEAR(state.distance_m, expected.sum_m / static_cast<double>(expected.count), step_m);
      }
    }
    if (expected.cleared_margin < kMargin * 10) continue;
    cleared += expected.cleared ? 1u : 0u;
    ASSERT_EQ(state.cleared, expected.cleared) << ijk[0] << ' ' << ijk[1] << ' ' << ijk[2];
  }
  EXPECT_GT(observed, 1000u);
  EXPECT_GT(cleared, 300u);
  EXPECT_LT(left_out, compared / 20);
  // Nothing besides what the loops visited.
  std::uint64_t beyond = 0;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
      const VoxelState state = map.at(ijk);
      if ((state.weight > 0 || state.cleared) && loops.voxels.count({ijk.x(), ijk.y(), ijk.z()}) == 0) ++beyond;
    }
  }
  EXPECT_EQ(beyond, 0u);
}

struct Case {
  const char* name;
  TsdfParams params;
};

std::vector<Case> cases() {
  TsdfParams product;
  product.voxel_size_m = 0.01;
  product.truncation_distance_m = 0.04;
  TsdfParams wide = product;
  wide.truncation_distance_m = 0.1;
  TsdfParams coarse = product;
  coarse.voxel_size_m = 0.05;
  coarse.truncation_distance_m = 0.23;  // not a whole number of voxels
  TsdfParams unclamped = product;
  unclamped.clamp_min_m = -0.04;
  TsdfParams paper = product;
  paper.region = UpdateRegion::FullCube;
  paper.cleared_radius_voxels = 0;
  paper.cleared_begin_tau = 1;
  return {{"Product", product},
          {"ProductTauTenVoxels", wide},
          {"Coarse", coarse},
          {"Unclamped", unclamped},
          {"Paper", paper}};
}

class AgainstLoops : public testing::TestWithParam<Case> {};

TEST_P(AgainstLoops, WeightsAreEqualAndDistancesWithinAStep) {
  const TsdfParams& params = GetParam().params;
  PackedMap map(params);
  ScanIntegrator integrator(map);
  test::LoopTsdf loops(params);
  const auto v = static_cast<float>(params.voxel_size_m);
  // Dominant axes z, y and x, and a sensor so close that the band ends at it.
  const std::vector<Eigen::Vector3f> sensors = {Eigen::Vector3f(31, -12, 300) * v, Eigen::Vector3f(-90, 400, 70) * v,
                                                Eigen::Vector3f(-260, 8, -33) * v};
  for (unsigned scan = 0; scan < sensors.size(); ++scan) {
    const auto points = test::wavySheet(60, params.voxel_size_m, scan + 1);
    integrator.integrate(points, {&sensors[scan], 1});
    loops.integrate(points, {&sensors[scan], 1});
  }
  expectEqualMaps(map, loops);
}
INSTANTIATE_TEST_SUITE_P(Tsdf, AgainstLoops, testing::ValuesIn(cases()),
                         [](const auto& tested) { return std::string(tested.param.name); });

TEST(AgainstLoopsAlso, OneSensorAReturn) {
  TsdfParams params = cases()[0].params;
  PackedMap map(params);
  ScanIntegrator integrator(map);
  test::LoopTsdf loops(params);
  const auto points = test::wavySheet(100, params.voxel_size_m, 7);
  std::vector<Eigen::Vector3f> sensors;
  for (std::size_t n = 0; n < points.size(); ++n) {
    sensors.push_back(points[n] + Eigen::Vector3f(0.3f - 0.01f * static_cast<float>(n), 0.8f, 0.5f));
  }
  integrator.integrate(points, sensors);
  loops.integrate(points, sensors);
  expectEqualMaps(map, loops);
}

TEST(AgainstLoopsAlso, MoreReturnsInAVoxelThanNarrowSumsHold) {
  TsdfParams params = cases()[0].params;
  params.max_weight = 4095;
  PackedMap map(params);
  map.setCollisionDistance(0.005f);
  ScanIntegrator integrator(map);
  constexpr std::size_t kReturns = 70001;
  const std::vector<Eigen::Vector3f> points(kReturns, Eigen::Vector3f(0.0013f, -0.0021f, 0.0034f));
  const Eigen::Vector3f q(1.0f, 2.0f, 3.0f);
  const IntegrationResult result = integrator.integrate(points, {&q, 1});
  test::LoopTsdf loops(params);
  loops.integrate({points.data(), 1}, {&q, 1});
  const double step_m = params.truncation_distance_m / kSampleSteps;
  std::size_t observed = 0;
  for (const auto& [ijk, expected] : loops.voxels) {
    const VoxelState state = map.at(openvdb::Coord(ijk[0], ijk[1], ijk[2]));
    if (expected.update_margin >= kMargin) {
      ASSERT_EQ(state.weight, expected.count > 0 ? 4095u : 0u);
      if (expected.count > 0) {
        ASSERT_NEAR(state.distance_m, expected.sum_m, step_m);
      }
      observed += expected.count;
    }
    if (expected.cleared_margin >= kMargin) {
      ASSERT_EQ(state.cleared, expected.cleared);
    }
  }
  EXPECT_GT(observed, 15u);
  EXPECT_EQ(result.counts.distance_updates, loops.updates * kReturns);
  ASSERT_FALSE(result.changes.empty());
}

}  // namespace
}  // namespace accessvdb::internal
