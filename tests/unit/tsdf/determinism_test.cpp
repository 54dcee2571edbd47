// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The map is bit for bit the same for any number of threads and any order of the points within a scan.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <map>
#include <random>
#include <vector>

#include "hostdev/flips_hash.h"
#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

using Origin = std::array<std::int32_t, 3>;

/// Everything that a run produces, in canonical order.
struct Outcome {
  std::map<Origin, std::pair<std::vector<std::uint32_t>, std::vector<std::uint64_t>>> leaves;
  std::vector<std::map<Origin, std::array<LeafBits, 4>>> flips;  // one map per scan
  std::vector<std::uint64_t> flips_hashes;                       // one per scan
  std::uint64_t observed = 0, updates = 0, passes = 0;
  bool operator==(const Outcome&) const = default;
};

Outcome run(const std::vector<std::vector<Eigen::Vector3f>>& scans, UpdateRegion region, int threads) {
  Outcome outcome;
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    TsdfParams params;
    params.voxel_size_m = 0.01;
    params.truncation_distance_m = 0.04;
    params.region = region;
    PackedMap map(params);
    map.setCollisionDistance(0.005f);
    ScanIntegrator integrator(map);
    integrator.hashFlips(true);
    for (std::size_t n = 0; n < scans.size(); ++n) {
      const Eigen::Vector3f q(0.3f, 0.2f * static_cast<float>(n), 2.0f);
      const IntegrationResult result = integrator.integrate(scans[n], {&q, 1});
      outcome.updates += result.counts.distance_updates;
      outcome.passes += result.counts.cleared_updates;
      outcome.flips_hashes.push_back(result.flips_hash);
      std::uint64_t flips_hash = 0;
      auto& flips = outcome.flips.emplace_back();
      for (const auto& span : result.changes) {
        for (const LeafChange& c : span) {
          const bool first =
              flips.emplace(c.origin_ijk, std::array{c.collides_on, c.collides_off, c.arm_free_on, c.arm_free_off})
                  .second;
          EXPECT_TRUE(first) << "a leaf twice in one scan";
          flips_hash += kernels::flipsHash(c);
        }
      }
      EXPECT_EQ(result.flips_hash, flips_hash);
    }
    outcome.observed = map.observed_voxels;
    for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
      auto& [values, mask] = outcome.leaves[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}];
      LeafValues::Room room;
      if (const std::uint32_t* packed = LeafValues(*leaf).all(room)) values.assign(packed, packed + PackedLeaf::SIZE);
      for (openvdb::Index w = 0; w < 8; ++w) mask.push_back(leaf->getValueMask().getWord<openvdb::Index64>(w));
    }
  });
  return outcome;
}

std::vector<std::vector<Eigen::Vector3f>> threeScans() {
  return {test::wavySheet(3000, 0.01, 1), test::wavySheet(3000, 0.02, 2), test::wavySheet(3000, 0.04, 3)};
}

class EveryRegion : public testing::TestWithParam<UpdateRegion> {};

TEST_P(EveryRegion, ThreadsDoNotMatter) {
  const auto scans = threeScans();
  const Outcome expected = run(scans, GetParam(), 1);
  ASSERT_GT(expected.leaves.size(), 100u);
  ASSERT_FALSE(expected.flips[2].empty());
  for (const int threads : {2, 4, 16}) EXPECT_TRUE(run(scans, GetParam(), threads) == expected) << threads;
}

TEST_P(EveryRegion, OrderOfPointsDoesNotMatter) {
  auto scans = threeScans();
  const Outcome expected = run(scans, GetParam(), 2);
  std::mt19937 random(5);
  for (int n = 0; n < 20; ++n) {
    for (auto& scan : scans) std::shuffle(scan.begin(), scan.end(), random);
    ASSERT_TRUE(run(scans, GetParam(), 2) == expected) << "shuffle " << n;
  }
}
INSTANTIATE_TEST_SUITE_P(Tsdf, EveryRegion, testing::Values(UpdateRegion::DoubleCone, UpdateRegion::FullCube));

}  // namespace
}  // namespace accessvdb::internal
