// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// New things block (tsdf/new_things.h): the rule by itself, against an oracle that works return by return, and on
/// scenes in which something appears and goes.
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "tsdf/leaf_facts.h"
#include "tsdf/new_things.h"
#include "tsdf/scan_integrator.h"
#include "unit/tsdf/loop_tsdf.h"

namespace accessvdb::internal {
namespace {

using Origin = std::array<std::int32_t, 3>;
using Votes = std::map<Origin, VoxelVotes>;

Votes votesOf(const PackedMap& map) {
  Votes votes;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const VoxelVotes* of_leaf = map.votesOf(*leaf);
    if (of_leaf != nullptr) votes[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}] = *of_leaf;
  }
  EXPECT_EQ(votes.size(), map.votedLeafCount());
  return votes;
}

int stateOf(const VoxelVotes& votes, std::size_t voxel) {
  int state = 0;
  for (std::size_t n = 0; n < 3; ++n) {
    state |= static_cast<int>(votes.bit[n][voxel >> 6] >> (voxel & 63) & 1) << n;
  }
  return state;
}

constexpr std::array kAfterAVote = {1, 2, 7, 7, 7, 7, 7, 7};
constexpr std::array kAfterADenial = {0, 0, 0, 0, 3, 4, 5, 6};

TEST(NewThings, AVoteAndADenialFollowTheTable) {
  for (int state = 0; state < 8; ++state) {
    for (unsigned said = 0; said < 16; ++said) {  // every combination of what a scan can say
      VoxelVotes votes;
      const std::size_t voxel = 64 * 5 + 17 + static_cast<std::size_t>(state);
      const std::uint64_t bit = std::uint64_t{1} << (voxel & 63);
      for (std::size_t n = 0; n < 3; ++n) votes.bit[n][5] = (state >> n & 1) != 0 ? bit : 0;
      ScanVerdict scan;
      scan.contra[5] = (said & 1) != 0 ? bit : 0;
      scan.free[5] = (said & 2) != 0 ? bit : 0;
      scan.sampled[5] = (said & 4) != 0 ? bit : 0;
      scan.contradicts[5] = (said & 8) != 0 && (said & 4) != 0 ? bit : 0;
      LeafBits before, after;
      castVotes(votes, scan, before, after);
      const bool contradicts = (said & 12) == 12, vote = contradicts && (said & 3) == 3;
      const bool denial = (said & 4) != 0 && !contradicts;
      const auto s = static_cast<std::size_t>(state);
      const int expected = vote ? kAfterAVote[s] : denial ? kAfterADenial[s] : state;
      EXPECT_EQ(stateOf(votes, voxel), expected) << state << ' ' << said;
      EXPECT_EQ(before[5], state >= 3 ? bit : 0);
      EXPECT_EQ(after[5], expected >= 3 ? bit : 0);
      for (const LeafBits& plane : votes.bit) {
        for (std::size_t word = 0; word < 8; ++word) EXPECT_EQ(plane[word] & ~(word == 5 ? bit : 0), 0u);
      }
    }
  }
}

TsdfParams fourVoxels() {
  TsdfParams params;
  params.voxel_size_m = 0.01;
  params.truncation_distance_m = 0.06;
  return params;
}
constexpr float kCollides_m = 0.005f, kFar_m = 0.025f;

/// A sheet that moves back and forth by more than the margin, so that things appear, stay and go.
std::vector<std::vector<Eigen::Vector3f>> movingSheet(std::size_t scans, std::size_t returns) {
  std::vector<std::vector<Eigen::Vector3f>> list;
  for (unsigned n = 0; n < scans; ++n) {
    auto points = test::wavySheet(returns, 0.01, n + 1);
    const float shift = n < 6 ? 0 : n / 8 % 2 == 0 ? 0.035f : -0.03f;
    for (std::size_t k = 0; k < points.size(); ++k) points[k].z() += k % 3 == 0 ? 0 : shift;
    list.push_back(points);
  }
  return list;
}
Eigen::Vector3f sensorOf(std::size_t scan) { return {0.3f, 0.1f * static_cast<float>(scan), 2.0f}; }

/// The rule, return by return: each is fused alone into a map of its own, so that its samples are known one by one.
class VoteOracle {
 public:
  explicit VoteOracle(const TsdfParams& params) : params_(params), still_(params), integrator_(still_) {
    still_.setCollisionDistance(kCollides_m);
  }

  void integrate(const std::vector<Eigen::Vector3f>& p_L, const Eigen::Vector3f& q_L) {
    struct Samples {
      std::uint64_t sum = 0, count = 0;
      bool contra = false;
    };
    std::map<Origin, std::array<Samples, 512>> scan;
    for (const Eigen::Vector3f& p : p_L) {
      const VoxelState own = still_.at(voxelOf(p));
      const bool young = own.weight <= 8 && !(own.distance_m >= kCollides_m);
      const bool news = own.weight > 0 && (own.distance_m >= kFar_m || young);
      returns_of_news_ += news ? 1 : 0;
      PackedMap alone(params_);
      ScanIntegrator(alone).integrate({&p, 1}, {&q_L, 1});
      for (auto leaf = alone.tree().cbeginLeaf(); leaf; ++leaf) {
        LeafValues::Room room;
        const std::uint32_t* packed = LeafValues(*leaf).all(room);
        if (packed == nullptr) continue;
        auto& of_leaf = scan[{leaf->origin().x(), leaf->origin().y(), leaf->origin().z()}];
        for (std::size_t n = 0; n < 512; ++n) {
          if (weightOf(packed[n]) == 0) continue;
          of_leaf[n].sum += meanOf(packed[n]);
          ++of_leaf[n].count;
          of_leaf[n].contra = of_leaf[n].contra || (news && meanOf(packed[n]) < still_.collisionMean());
        }
      }
    }
    for (const auto& [origin, samples] : scan) {
      for (std::size_t n = 0; n < 512; ++n) {
        if (samples[n].count == 0) continue;
        const openvdb::Coord ijk(origin[0] + static_cast<int>(n >> 6), origin[1] + static_cast<int>(n >> 3 & 7),
                                 origin[2] + static_cast<int>(n & 7));
        const PackedLeaf* leaf = still_.tree().probeConstLeaf(ijk);
        LeafValues::Room room;
        const std::uint32_t* packed = leaf == nullptr ? nullptr : LeafValues(*leaf).all(room);
        const std::uint64_t old = packed == nullptr ? 0 : packed[n], mean = meanOf(static_cast<std::uint32_t>(old));
        const bool contradicts = 2 * samples[n].sum < mean * samples[n].count;
        const bool free = weightOf(static_cast<std::uint32_t>(old)) > 0 && mean >= still_.collisionMean();
        auto& state = states_[origin][n];
        const auto s = static_cast<std::size_t>(state);
        if (!contradicts) state = kAfterADenial[s];
        if (contradicts && free && samples[n].contra) state = kAfterAVote[s];
      }
    }
    integrator_.integrate(p_L, {&q_L, 1});
  }

  [[nodiscard]] int stateOf(const Origin& origin, std::size_t n) const {
    const auto found = states_.find(origin);
    return found == states_.end() ? 0 : found->second[n];
  }
  [[nodiscard]] std::array<std::uint64_t, 8> counts() const {
    std::array<std::uint64_t, 8> counts = {};
    for (const auto& [origin, states] : states_) {
      for (const int state : states) ++counts[static_cast<std::size_t>(state)];
    }
    return counts;
  }
  [[nodiscard]] const PackedMap& still() const { return still_; }
  [[nodiscard]] std::uint64_t returnsOfNews() const { return returns_of_news_; }

 private:
  [[nodiscard]] openvdb::Coord voxelOf(const Eigen::Vector3f& p) const {
    const Eigen::Vector3d x = p.cast<double>() / params_.voxel_size_m;
    return {static_cast<int>(std::floor(x.x() + 0.5)), static_cast<int>(std::floor(x.y() + 0.5)),
            static_cast<int>(std::floor(x.z() + 0.5))};
  }
  TsdfParams params_;
  PackedMap still_;
  ScanIntegrator integrator_;
  std::map<Origin, std::array<int, 512>> states_;
  std::uint64_t returns_of_news_ = 0;
};

void expectEqual(const PackedMap& map, const VoteOracle& oracle, std::size_t scan) {
  ASSERT_EQ(map.leaf_count, oracle.still().leaf_count);
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const Origin origin = {leaf->origin().x(), leaf->origin().y(), leaf->origin().z()};
    const PackedLeaf* still = oracle.still().tree().probeConstLeaf(leaf->origin());
    ASSERT_NE(still, nullptr);
    LeafValues::Room room, same_room;
    const std::uint32_t *values = LeafValues(*leaf).all(room), *same = LeafValues(*still).all(same_room);
    ASSERT_EQ(values == nullptr, same == nullptr);
    if (values == nullptr) continue;
    const LeafChange facts = factsOf(map, *leaf), base = factsOf(oracle.still(), *still);
    const VoxelVotes* votes = map.votesOf(*leaf);
    for (std::size_t n = 0; n < 512; ++n) {
      ASSERT_EQ(values[n], same[n]) << "votes must not change the map itself";
      const int state = oracle.stateOf(origin, n);
      ASSERT_EQ(votes == nullptr ? 0 : stateOf(*votes, n), state) << "scan " << scan << " voxel " << n;
      const auto bit = [n](const LeafBits& bits) { return (bits[n >> 6] >> (n & 63) & 1) != 0; };
      ASSERT_EQ(bit(facts.collides_on), bit(base.collides_on) || state >= 3);
      ASSERT_EQ(bit(facts.arm_free_on), bit(base.arm_free_on) && state < 3);
      const VoxelState at = map.at(leaf->offsetToGlobalCoord(static_cast<openvdb::Index>(n)));
      ASSERT_EQ(at.blocked, state >= 3);
      if (at.blocked) {
        ASSERT_EQ(at.distance_m, 0.0f);
      }
    }
  }
}

/// The base map keeps its bits, and its facts are contained in those with votes: nothing becomes accessible.
TEST(NewThings, EqualTheRuleReturnByReturn) {
  const auto scans = movingSheet(34, 260);
  PackedMap map(fourVoxels());
  map.setCollisionDistance(kCollides_m);
  map.blockNewThings(kFar_m);
  ScanIntegrator integrator(map);
  VoteOracle oracle(fourVoxels());
  std::array<std::uint64_t, 8> seen = {};
  for (std::size_t n = 0; n < scans.size(); ++n) {
    const Eigen::Vector3f q = sensorOf(n);
    integrator.integrate(scans[n], {&q, 1});
    oracle.integrate(scans[n], q);
    expectEqual(map, oracle, n);
    if (HasFatalFailure()) return;
    const auto counts = oracle.counts();
    for (std::size_t state = 0; state < 8; ++state) seen[state] += counts[state];
  }
  for (std::size_t state = 0; state < 8; ++state) EXPECT_GT(seen[state], 20u) << "state " << state;
  EXPECT_GT(oracle.returnsOfNews(), 500u);
}

/// Everything that depends on votes, in canonical order: the votes themselves, and each scan's flips.
struct Outcome {
  std::vector<Votes> votes;
  std::vector<std::map<Origin, std::array<LeafBits, 4>>> flips;
};

Outcome run(const std::vector<std::vector<Eigen::Vector3f>>& scans, int threads) {
  Outcome outcome;
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  tbb::task_arena arena(threads);
  arena.execute([&] {
    PackedMap map(fourVoxels());
    map.setCollisionDistance(kCollides_m);
    map.blockNewThings(kFar_m);
    ScanIntegrator integrator(map);
    for (std::size_t n = 0; n < scans.size(); ++n) {
      const Eigen::Vector3f q = sensorOf(n);
      auto& flips = outcome.flips.emplace_back();
      for (const auto& span : integrator.integrate(scans[n], {&q, 1}).changes) {
        for (const LeafChange& c : span) {
          flips.emplace(c.origin_ijk, std::array{c.collides_on, c.collides_off, c.arm_free_on, c.arm_free_off});
        }
      }
      outcome.votes.push_back(votesOf(map));
    }
  });
  return outcome;
}

TEST(NewThings, DependNeitherOnThreadsNorOnTheOrderOfReturns) {
  auto scans = movingSheet(20, 1500);
  const Outcome expected = run(scans, 1);
  std::size_t voted = 0;
  for (const Votes& votes : expected.votes) voted += votes.size();
  EXPECT_GT(voted, 100u);
  std::mt19937 random(3);
  for (const int threads : {1, 2, 8, 8, 3}) {
    const Outcome outcome = run(scans, threads);
    EXPECT_TRUE(outcome.votes == expected.votes) << threads;
    EXPECT_TRUE(outcome.flips == expected.flips) << threads;
    for (auto& scan : scans) std::shuffle(scan.begin(), scan.end(), random);
  }
}

/// Flips are the difference of the facts before and after, as read from at().
TEST(NewThings, FlipsAreTheDifferenceOfTheFacts) {
  const auto scans = movingSheet(24, 800);
  PackedMap map(fourVoxels());
  map.setCollisionDistance(kCollides_m);
  map.blockNewThings(kFar_m);
  ScanIntegrator integrator(map);
  std::map<Origin, LeafChange> before;
  std::uint64_t released = 0, blocked = 0;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    const Eigen::Vector3f q = sensorOf(n);
    const Votes votes_before = votesOf(map);
    std::map<Origin, LeafChange> flips, after;
    for (const auto& span : integrator.integrate(scans[n], {&q, 1}).changes) {
      for (const LeafChange& change : span) flips[change.origin_ijk] = change;
    }
    for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
      LeafChange facts;
      for (openvdb::Index k = 0; k < 512; ++k) {
        const VoxelState state = map.at(leaf->offsetToGlobalCoord(k));
        const std::uint64_t bit = std::uint64_t{1} << (k & 63);
        const bool collides = state.weight > 0 && !(state.distance_m >= kCollides_m);
        if (collides) facts.collides_on[k >> 6] |= bit;
        if (state.weight > 0 ? !collides : state.cleared) facts.arm_free_on[k >> 6] |= bit;
      }
      const Origin origin = {leaf->origin().x(), leaf->origin().y(), leaf->origin().z()};
      const LeafChange old = before.contains(origin) ? before.at(origin) : LeafChange{};
      const LeafChange flip = flips.contains(origin) ? flips.at(origin) : LeafChange{};
      for (std::size_t x = 0; x < 8; ++x) {
        ASSERT_EQ(flip.collides_on[x], facts.collides_on[x] & ~old.collides_on[x]) << n;
        ASSERT_EQ(flip.collides_off[x], old.collides_on[x] & ~facts.collides_on[x]) << n;
        ASSERT_EQ(flip.arm_free_on[x], facts.arm_free_on[x] & ~old.arm_free_on[x]) << n;
        ASSERT_EQ(flip.arm_free_off[x], old.arm_free_on[x] & ~facts.arm_free_on[x]) << n;
        const std::uint64_t was = votes_before.contains(origin) ? votes_before.at(origin).blocked(x) : 0;
        const std::uint64_t is = map.votesOf(*leaf) != nullptr ? map.votesOf(*leaf)->blocked(x) : 0;
        released += static_cast<std::uint64_t>(std::popcount(was & ~is & flip.arm_free_on[x]));
        blocked += static_cast<std::uint64_t>(std::popcount(is & ~was & flip.arm_free_off[x]));
      }
      after[origin] = facts;
    }
    before = std::move(after);
  }
  EXPECT_GT(blocked, 50u);
  EXPECT_GT(released, 20u);
}

/// More returns than narrow sums hold vote like one: 30 equal returns have the mean of one.
TEST(NewThings, OfWideSumsVoteAlike) {
  TsdfParams params = fourVoxels();
  params.max_weight = 4095;
  const Eigen::Vector3f q(0, 0, 2);
  std::array<Votes, 2> votes;
  for (std::size_t wide = 0; wide < 2; ++wide) {
    PackedMap map(params);
    map.setCollisionDistance(kCollides_m);
    map.blockNewThings(kFar_m);
    ScanIntegrator integrator(map);
    for (int scan = 0; scan < 14; ++scan) {
      std::vector<Eigen::Vector3f> points;
      for (int k = 0; k < 16; ++k) {
        const bool near = scan >= 10 && k % 4 != 0;  // no voxel is young by then
        points.insert(points.end(), wide != 0 ? 30 : 1,
                      Eigen::Vector3f(0.003f + 0.01f * static_cast<float>(k % 4), 0.01f * static_cast<float>(k / 4),
                                      near ? 0.04f : 0.0f));
      }
      integrator.integrate(points, {&q, 1});
    }
    votes[wide] = votesOf(map);
  }
  EXPECT_FALSE(votes[0].empty());
  EXPECT_TRUE(votes[0] == votes[1]);
}

}  // namespace
}  // namespace accessvdb::internal
