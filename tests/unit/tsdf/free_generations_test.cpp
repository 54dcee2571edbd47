// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Free space ages: against a second map that is asked, scan by scan, what each scan alone confirms.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <random>
#include <vector>

#include "tsdf/leaf_facts.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

constexpr double kFreeFor_s = 10;

TsdfParams paramsOf() {
  TsdfParams params;
  params.voxel_size_m = 0.05;
  params.truncation_distance_m = 0.2;
  return params;
}

/// A map with what feeds it. @param free_for_s  infinity: it does not age
struct Mapper {
  explicit Mapper(double free_for_s) : map(paramsOf()), integrator((prepare(map, free_for_s), map)) {}
  static void prepare(PackedMap& map, double free_for_s) {
    map.setCollisionDistance(0.025f);
    map.blockNewThings(0.125f);
    if (std::isfinite(free_for_s)) map.ageFreeSpace(free_for_s);
  }
  IntegrationResult fuse(const std::vector<Eigen::Vector3f>& returns, const Eigen::Vector3f& sensor) {
    return integrator.integrate(returns, {&sensor, 1});
  }
  PackedMap map;
  ScanIntegrator integrator;
};

struct Facts {
  LeafBits collides = {}, arm_free = {};
  bool operator==(const Facts&) const = default;
};
/// Only of leaves that have any.
using FactsOfMap = std::map<openvdb::Coord, Facts>;

FactsOfMap factsOfMap(const PackedMap& map) {
  FactsOfMap all;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const LeafChange facts = factsOf(map, *leaf);
    const Facts found = {facts.collides_on, facts.arm_free_on};
    if (found != Facts{}) all[leaf->origin()] = found;
  }
  return all;
}

void apply(FactsOfMap& facts, const LeafChange& change) {
  Facts& leaf = facts[{change.origin_ijk[0], change.origin_ijk[1], change.origin_ijk[2]}];
  for (std::size_t x = 0; x < 8; ++x) {
    EXPECT_EQ(change.arm_free_on[x] & leaf.arm_free[x], 0u);
    EXPECT_EQ(change.arm_free_off[x] & ~leaf.arm_free[x], 0u);
    leaf.collides[x] = (leaf.collides[x] | change.collides_on[x]) & ~change.collides_off[x];
    leaf.arm_free[x] = (leaf.arm_free[x] | change.arm_free_on[x]) & ~change.arm_free_off[x];
  }
  if (leaf == Facts{}) facts.erase({change.origin_ijk[0], change.origin_ijk[1], change.origin_ijk[2]});
}

std::vector<LeafChange> agedLeaves(PackedMap& map, double passed_s) {
  std::vector<LeafChange> all;
  for (const auto& part : map.generations()->pass(map, passed_s)) all.insert(all.end(), part.begin(), part.end());
  return all;
}

std::vector<Eigen::Vector3f> wallFrom(std::mt19937& random, const Eigen::Vector3f& sensor, int count,
                                      bool thing = false) {
  std::uniform_real_distribution<float> across(-1.5f, 1.5f), noise(-0.02f, 0.02f);
  std::vector<Eigen::Vector3f> returns;
  for (int n = 0; n < count; ++n) {
    // A wall, and now and then something before it.
    const Eigen::Vector3f at(random() % 5 == 0 ? 1.4f : 2.0f, across(random), across(random));
    if (thing && std::abs(at.y()) < 0.5f) {
      returns.push_back(at * (1.85f / at.x()));
      continue;
    }
    returns.push_back(at + (at - sensor).normalized() * noise(random));
  }
  return returns;
}

/// What no ray touches flips at T to 2 T, each node at its own time; nothing else flips.
TEST(FreeGenerations, WhatNoRayTouchesIsForgottenAtTTo2T) {
  Mapper mapper(kFreeFor_s);
  std::mt19937 random(3);
  mapper.fuse(wallFrom(random, {0, 0, 0}, 800), {0, 0, 0});
  mapper.fuse(wallFrom(random, {-9, 4, 3}, 800), {-9, 4, 3});
  const FactsOfMap first = factsOfMap(mapper.map);
  FactsOfMap known = first;
  constexpr double kStep_s = 0.25;
  std::map<std::int64_t, int> times;
  for (double at_s = kStep_s; at_s <= 2 * kFreeFor_s; at_s += kStep_s) {
    for (const LeafChange& change : agedLeaves(mapper.map, kStep_s)) {
      EXPECT_EQ(change.collides_on, LeafBits{});
      EXPECT_EQ(change.collides_off, LeafBits{});
      EXPECT_EQ(change.arm_free_on, LeafBits{});
      apply(known, change);
      EXPECT_GE(at_s, kFreeFor_s);
      ++times[static_cast<std::int64_t>(at_s / kStep_s)];
    }
    ASSERT_EQ(factsOfMap(mapper.map), known);
  }
  std::uint64_t free_before = 0;
  for (const auto& [origin, facts] : first) {
    for (const std::uint64_t word : facts.arm_free) free_before += static_cast<std::uint64_t>(std::popcount(word));
    EXPECT_EQ(known[origin].arm_free, LeafBits{});
    EXPECT_EQ(known[origin].collides, facts.collides) << "collisions do not age";
  }
  EXPECT_GT(free_before, 2000u);
  EXPECT_GE(times.size(), 2u) << "nodes turn at different times";
  EXPECT_EQ(mapper.map.agedLeafCount(), 0u);
}

/// Random scans at random times. The oracle keeps, for each voxel, the generation in which a scan last confirmed it:
/// one that passed it, or whose own mean there is free, as a fresh map of that scan alone says.
TEST(FreeGenerations, AVoxelIsFreeWhileOneOfTwoGenerationsConfirmedIt) {
  Mapper ages(kFreeFor_s), still(std::numeric_limits<double>::infinity());
  std::map<openvdb::Coord, std::int64_t> confirmed;
  FactsOfMap known;
  std::mt19937 random(11);
  std::uint64_t forgotten = 0, measured_free_forgotten = 0, votes = 0;
  for (int scan = 0; scan < 90; ++scan) {
    // Sometimes far more than 2 T passes, sometimes none.
    const double passed_s = scan % 30 == 29 ? 35 : scan % 7 == 3 ? 0 : 0.1 * static_cast<double>(random() % 30);
    for (const LeafChange& change : agedLeaves(ages.map, passed_s)) apply(known, change);
    const Eigen::Vector3f sensor(0, 0.3f * static_cast<float>(scan % 9) - 1.2f, scan % 2 == 0 ? 0.4f : -0.9f);
    // The first rays again and again: more than 255 in a leaf take the wide path.
    const auto returns = wallFrom(random, sensor, scan % 10 == 0 ? 20000 : 300, scan % 45 > 35);
    Mapper alone(std::numeric_limits<double>::infinity());
    alone.fuse(returns, sensor);
    still.fuse(returns, sensor);
    const IntegrationResult result = ages.fuse(returns, sensor);
    for (const auto& part : result.changes) {
      for (const LeafChange& change : part) apply(known, change);
    }
    const auto generationOf = [&](const openvdb::Coord& ijk) {
      return ages.map.generations()->generationOf(ijk.x() & ~127, ijk.y() & ~127, ijk.z() & ~127);
    };
    for (auto leaf = alone.map.tree().cbeginLeaf(); leaf; ++leaf) {
      LeafValues::Room room;
      const std::uint32_t* values = LeafValues(*leaf).all(room);
      for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
        const bool free =
            values != nullptr && weightOf(values[n]) > 0 && meanOf(values[n]) >= alone.map.collisionMean();
        if (free || leaf->isValueOn(n))
          confirmed[leaf->offsetToGlobalCoord(n)] = generationOf(leaf->offsetToGlobalCoord(n));
      }
    }
    ASSERT_EQ(factsOfMap(ages.map), known) << "flips and facts, scan " << scan;
    for (auto leaf = still.map.tree().cbeginLeaf(); leaf; ++leaf) {
      const PackedLeaf* aged = ages.map.tree().probeConstLeaf(leaf->origin());
      ASSERT_NE(aged, nullptr);
      LeafValues::Room room, aged_room;
      const std::uint32_t *values = LeafValues(*leaf).all(room), *aged_values = LeafValues(*aged).all(aged_room);
      ASSERT_EQ(values == nullptr, aged_values == nullptr);
      const LeafChange facts = factsOf(ages.map, *aged);
      for (openvdb::Index n = 0; n < PackedLeaf::SIZE; ++n) {
        ASSERT_TRUE(values == nullptr || values[n] == aged_values[n]) << "distances and weights do not age";
        const openvdb::Coord ijk = leaf->offsetToGlobalCoord(n);
        const VoxelState state = still.map.at(ijk);
        const bool collides = state.weight > 0 && state.distance_m < 0.025f;
        const auto found = confirmed.find(ijk);
        const bool recent = found != confirmed.end() && generationOf(ijk) - found->second <= 1;
        ASSERT_EQ((facts.collides_on[n >> 6] >> (n & 63) & 1) != 0, collides);
        ASSERT_EQ((facts.arm_free_on[n >> 6] >> (n & 63) & 1) != 0, recent && !collides) << "scan " << scan << ijk;
        forgotten += !recent && state.cleared ? 1 : 0;
        measured_free_forgotten += !recent && state.weight > 0 && !collides ? 1 : 0;
        votes += state.blocked ? 1 : 0;
      }
    }
  }
  EXPECT_GT(forgotten, 1000u);
  EXPECT_GT(measured_free_forgotten, 1000u);
  EXPECT_GT(votes, 0u) << "votes and generations share a record";
}

TEST(FreeGenerations, BadTimesAgeNothing) {
  Mapper mapper(kFreeFor_s);
  std::mt19937 random(3);
  mapper.fuse(wallFrom(random, {0, 0, 0}, 300), {0, 0, 0});
  const FactsOfMap before = factsOfMap(mapper.map);
  for (const double bad :
       {0.0, -1e9, -std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_TRUE(mapper.map.generations()->pass(mapper.map, bad).empty());
  }
  EXPECT_EQ(mapper.map.generations()->age_s(), 0);
  EXPECT_EQ(factsOfMap(mapper.map), before);
  // A jump, as of stamps in the wrong unit, forgets everything, and counts as 2 T.
  mapper.map.generations()->pass(mapper.map, 1e18);
  EXPECT_EQ(mapper.map.generations()->age_s(), 2 * kFreeFor_s);
  for (const auto& [origin, facts] : factsOfMap(mapper.map)) EXPECT_EQ(facts.arm_free, LeafBits{});
}

/// When a node turns depends on its place and the time alone, not on what else there is or came first.
TEST(FreeGenerations, ANodesTimeDependsOnItsPlaceAlone) {
  Mapper small(kFreeFor_s), large(kFreeFor_s);
  std::mt19937 random(3);
  const auto own = wallFrom(random, {0, 0, 0}, 300);
  for (int n = 0; n < 40; ++n) {
    const Eigen::Vector3f sensor(20.0f * static_cast<float>(n), 30, 0);
    std::vector<Eigen::Vector3f> far;
    for (const Eigen::Vector3f& p : own) far.push_back(p + sensor);
    large.fuse(far, sensor);
  }
  large.fuse(own, {0, 0, 0});
  small.fuse(own, {0, 0, 0});
  std::uint64_t compared = 0;
  for (int step = 0; step < 80; ++step) {
    small.map.generations()->pass(small.map, 0.25);
    large.map.generations()->pass(large.map, 0.25);
    const FactsOfMap of_large = factsOfMap(large.map);
    for (const auto& [origin, facts] : factsOfMap(small.map)) {
      ASSERT_EQ(facts, of_large.at(origin)) << step;
      ++compared;
    }
  }
  EXPECT_GT(compared, 1000u);
}

}  // namespace
}  // namespace accessvdb::internal
