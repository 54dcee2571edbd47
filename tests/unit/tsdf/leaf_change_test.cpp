// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What integrate() reports as flipped is the difference of the facts before and after, recomputed from at().
#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

constexpr float kCollisionDistance_m = 0.005f;

struct Facts {
  bool collides = false, arm_free = false;
};
Facts factsOf(const VoxelState& state) {
  const bool collides = state.weight > 0 && !(state.distance_m >= kCollisionDistance_m);
  return {collides, state.weight > 0 ? !collides : state.cleared};
}

using FactMap = std::map<std::array<std::int32_t, 3>, std::array<Facts, 512>>;
FactMap allFacts(const PackedMap& map) {
  FactMap facts;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    auto& of_leaf = facts[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}];
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) of_leaf[n] = factsOf(map.at(leaf->offsetToGlobalCoord(n)));
  }
  return facts;
}

bool bitOf(const LeafBits& bits, std::size_t n) { return (bits[n >> 6] >> (n & 63) & 1) != 0; }

void expectChanges(const FactMap& before, const FactMap& after, const IntegrationResult& result,
                   std::array<std::size_t, 4>& kinds) {
  std::map<std::array<std::int32_t, 3>, LeafChange> changes;
  for (const auto& span : result.changes) {
    for (const LeafChange& change : span) changes[change.origin_ijk] = change;
  }
  for (const auto& [origin, now] : after) {
    const auto found = before.find(origin);
    const LeafChange change = changes.count(origin) > 0 ? changes.at(origin) : LeafChange{};
    std::size_t flips = 0;
    for (std::size_t n = 0; n < 512; ++n) {
      const Facts old = found == before.end() ? Facts{} : found->second[n];
      const std::array<bool, 4> expected = {!old.collides && now[n].collides, old.collides && !now[n].collides,
                                            !old.arm_free && now[n].arm_free, old.arm_free && !now[n].arm_free};
      const std::array<bool, 4> reported = {bitOf(change.collides_on, n), bitOf(change.collides_off, n),
                                            bitOf(change.arm_free_on, n), bitOf(change.arm_free_off, n)};
      ASSERT_EQ(reported, expected) << origin[0] << ' ' << origin[1] << ' ' << origin[2] << " voxel " << n;
      for (std::size_t kind = 0; kind < 4; ++kind) {
        kinds[kind] += expected[kind] ? 1u : 0u;
        flips += expected[kind] ? 1u : 0u;
      }
    }
    EXPECT_EQ(changes.count(origin), flips > 0 ? 1u : 0u) << "leaves without a flip are not listed";
    changes.erase(origin);
  }
  EXPECT_TRUE(changes.empty());
}

TsdfParams fourVoxels() {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.04;
  return params;
}

TEST(LeafChanges, AreTheDifferenceOfTheFacts) {
  PackedMap map(fourVoxels());
  map.setCollisionDistance(kCollisionDistance_m);
  ScanIntegrator integrator(map);
  std::array<std::size_t, 4> kinds = {};
  for (unsigned scan = 0; scan < 6; ++scan) {
    // The sheet moves back and forth, so that all four kinds of flips occur.
    auto points = test::wavySheet(1500, 0.01, scan + 1);
    for (auto& point : points) point.z() += 0.02f * static_cast<float>(scan % 3);
    const Eigen::Vector3f q(0.2f, -0.4f, scan % 2 == 0 ? 2.0f : 1.0f);
    const FactMap before = allFacts(map);
    const IntegrationResult result = integrator.integrate(points, {&q, 1});
    expectChanges(before, allFacts(map), result, kinds);
  }
  for (const std::size_t count : kinds) EXPECT_GT(count, 50u);
}

TEST(LeafChanges, OfWideSumsToo) {
  PackedMap map(fourVoxels());
  map.setCollisionDistance(kCollisionDistance_m);
  ScanIntegrator integrator(map);
  std::array<std::size_t, 4> kinds = {};
  const std::vector<Eigen::Vector3f> near(40000, Eigen::Vector3f(0.001f, 0.002f, 0.0f));
  const std::vector<Eigen::Vector3f> behind(40000, Eigen::Vector3f(0.001f, 0.002f, -0.03f));
  const Eigen::Vector3f q(0.1f, 0.2f, 3.0f);
  for (const auto* scan : {&near, &behind}) {
    const FactMap before = allFacts(map);
    const IntegrationResult result = integrator.integrate(*scan, {&q, 1});
    expectChanges(before, allFacts(map), result, kinds);
  }
  EXPECT_GT(kinds[0], 0u);
  EXPECT_GT(kinds[1], 0u);
  EXPECT_GT(kinds[2], 0u);
}

/// Narrow sums hold 255 returns per leaf. Equal returns have the mean of one, and each counts once.
TEST(LeafChanges, OfAsManyReturnsAsNarrowSumsHoldAndMore) {
  const Eigen::Vector3f p(0.001f, 0.002f, 0.0f), q(0.1f, 0.2f, 3.0f);
  PackedMap one(fourVoxels());
  ScanIntegrator(one).integrate({&p, 1}, {&q, 1});
  for (const std::uint32_t count : {254u, 255u, 256u, 510u, 511u}) {
    SCOPED_TRACE(count);
    PackedMap many(fourVoxels());
    const std::vector<Eigen::Vector3f> scan(count, p);
    const IntegrationResult result = ScanIntegrator(many).integrate(scan, {&q, 1});
    EXPECT_EQ(result.counts.newly_observed, one.observed_voxels);
    EXPECT_EQ(result.counts.distance_updates, count * one.observed_voxels);
    ASSERT_EQ(many.leaf_count, one.leaf_count);
    for (auto leaf = one.tree().cbeginLeaf(); leaf; ++leaf) {
      for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
        const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
        const VoxelState expected = one.at(ijk), state = many.at(ijk);
        ASSERT_EQ(state.weight, expected.weight * count);
        ASSERT_EQ(state.distance_m, expected.distance_m);
        ASSERT_EQ(state.cleared, expected.cleared);
      }
    }
  }
}

TEST(LeafChanges, ClearedIsNeverTakenBackAndTouchesNoDistance) {
  PackedMap map(fourVoxels());
  map.setCollisionDistance(kCollisionDistance_m);
  ScanIntegrator integrator(map);
  const Eigen::Vector3f q(0, 0, 2);
  const std::vector<Eigen::Vector3f> scan = test::wavySheet(500, 0.01, 1);
  integrator.integrate(scan, {&q, 1});
  std::map<openvdb::Coord, VoxelState> before;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
      before[leaf->offsetToGlobalCoord(n)] = map.at(leaf->offsetToGlobalCoord(n));
    }
  }
  // These returns are far below; only their bands, not their cones, reach some of the old leaves.
  std::vector<Eigen::Vector3f> below = scan;
  for (auto& point : below) point.z() -= 0.16f;
  for (auto& point : below) point.z() = std::min(point.z(), -0.16f);
  const IntegrationResult result = integrator.integrate(below, {&q, 1});
  ASSERT_GT(result.counts.cleared_updates, 0u);
  std::size_t passed_again = 0;
  for (const auto& [ijk, old] : before) {
    if (ijk.z() < -11) continue;
    const VoxelState now = map.at(ijk);
    ASSERT_EQ(now.weight, old.weight);
    ASSERT_EQ(now.distance_m, old.distance_m);
    if (old.cleared) {
      ASSERT_TRUE(now.cleared);
    } else if (now.cleared) {
      ++passed_again;
    }
  }
  EXPECT_GT(passed_again, 10u);
}

}  // namespace
}  // namespace accessvdb::internal
