// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A map that a device fuses first, with a device that is a second map on the host: what follows gets every scan,
// whatever the device says.
#include "field/leading_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "field/mirrors.h"
#include "field/point_weights.h"
#include "launch/backend.h"
#include "support/map_hash.h"
#include "tsdf/leaf_facts.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::internal {
namespace {

using Origin = kernels::GridGrowth::Origin;
using kernels::FollowingMap;

FieldParams smallMap() {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.02;
  params.tsdf.truncation_distance_m = 0.08;
  params.threads = 2;
  return params;
}

struct OneMap {
  OneMap() : map(smallMap().tsdf), integrator(map) {
    map.setCollisionDistance(0.01f);
    integrator.hashFlips(true);
  }
  PackedMap map;
  ScanIntegrator integrator;
};

struct LedScan {
  std::vector<Eigen::Vector3f> p_L, q_L;
};

std::vector<LedScan> scansOf(int count) {
  std::mt19937 random(11);
  const auto uniform = [&](float low, float high) {
    return low + (high - low) * static_cast<float>(random() % 65536) / 65536.0f;
  };
  std::vector<LedScan> scans(static_cast<std::size_t>(count));
  for (LedScan& scan : scans) {
    const float x = uniform(-0.5f, 0.5f);
    scan.q_L.emplace_back(x, 0.1f, 1.8f);
    for (int n = 0; n < 300; ++n) {
      const float dx = uniform(-0.4f, 0.4f), y = uniform(-0.4f, 0.4f);
      scan.p_L.emplace_back(4 * x + dx, y, uniform(-0.08f, 0.08f));
    }
  }
  return scans;
}

/// Fuses into a map of its own. It adds nodes as a device does, but writes nothing to the grid.
class PretendedFuser final : public kernels::ScanFuser {
 public:
  explicit PretendedFuser(const std::vector<LedScan>& scans) : scans_(scans) {}

  void begin(const kernels::GridSpace&, std::span<const Origin> with_values,
             std::span<const kernels::VotesRecord> votes) override {
    begun.with_values.assign(with_values.begin(), with_values.end());
    begun.votes.assign(votes.begin(), votes.end());
  }
  kernels::FusedScan fuse(std::span<const kernels::ReturnRay> rays, std::uint32_t, const kernels::GridSpace& space,
                          const Reserve& reserve, FollowingMap& host) override {
    if (act) act(host);
    const LedScan& scan = scans_[next_++];
    EXPECT_EQ(rays.size(), scan.p_L.size());
    EXPECT_EQ(space, space_.top_bytes == 0 ? space : space_);
    const IntegrationResult result = of_device_->integrator.integrate(scan.p_L, scan.q_L);
    uppers_.clear();
    lowers_.clear();
    leaves_.clear();
    for (const auto& part : result.changes) {
      for (const LeafChange& change : part) note(change.origin_ijk);
    }
    kernels::FusedScan fused;
    fused.counts = result.counts;
    fused.touched_leaves = result.touched_leaves;
    fused.returned_leaves = returned;
    fused.flips_hash = result.flips_hash ^ (diverges ? 1 : 0);
    if (adds_again) leaves_.push_back(*known_leaves_.begin());
    fused.growth = {uppers_, lowers_, leaves_};
    reserve(kernels::growthBytes(space, fused.growth.counts()));
    space_ = kernels::grown(space, fused.growth.counts());
    return fused;
  }
  void readWeights(std::span<const Origin> voxels, int reach, std::span<std::uint16_t> weights,
                   FollowingMap&) override {
    if (!weights_fail.empty()) throw DeviceError(weights_fail, "cuda", "made up", "");
    readWeightsOfMap(of_device_->map, reach, voxels, weights);
  }
  kernels::FlipsOnDevice flips() const override { return {}; }
  void takeFlips(std::vector<kernels::LeafFlips>&, std::vector<std::uint16_t>&) override {}
  void clearFlips() override {}
  std::uint64_t bytes() const override { return 1; }

  std::function<void(FollowingMap& host)> act;  ///< before a scan is fused
  std::uint64_t returned = 0;                   ///< leaves, for each scan
  HeldByMap begun;                              ///< what the map held before
  bool diverges = false, adds_again = false;
  std::string weights_fail;  ///< how; empty: they do not

 private:
  void note(const Origin& leaf) {
    const auto down = [&](int bits) {
      return Origin{leaf[0] >> bits << bits, leaf[1] >> bits << bits, leaf[2] >> bits << bits};
    };
    if (known_uppers_.insert(down(12)).second) uppers_.push_back(down(12));
    if (known_lowers_.insert(down(7)).second) lowers_.push_back(down(7));
    if (known_leaves_.insert(leaf).second) leaves_.push_back(leaf);
  }

  const std::vector<LedScan>& scans_;
  std::size_t next_ = 0;
  std::unique_ptr<OneMap> of_device_ = std::make_unique<OneMap>();
  kernels::GridSpace space_;
  std::set<Origin> known_uppers_, known_lowers_, known_leaves_;
  std::vector<Origin> uppers_, lowers_, leaves_;
};

class LeadingMapTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto fuser = std::make_unique<PretendedFuser>(scans_);
    fuser_ = fuser.get();
    lead_ = std::make_unique<LeadingMap>(std::move(fuser), host_->map, host_->integrator, facts_, smallMap());
  }
  bool fuse(std::size_t n) { return lead_->fuse(scans_[n].p_L, scans_[n].q_L, {}).has_value(); }
  /// The host's map is that of so many scans.
  void expectScans(std::size_t count) {
    OneMap expected;
    for (std::size_t n = 0; n < count; ++n) expected.integrator.integrate(scans_[n].p_L, scans_[n].q_L);
    EXPECT_EQ(test::hashOf(host_->map), test::hashOf(expected.map)) << count;
    EXPECT_EQ(host_->map.leaf_count, expected.map.leaf_count);
  }
  std::string errorOf(std::size_t n) {
    try {
      fuse(n);
    } catch (const Error& error) {
      return error.id();
    }
    return "";
  }

  std::vector<LedScan> scans_ = scansOf(14);
  std::unique_ptr<kernels::Backend> backend_ = kernels::makeCpuBackend();
  std::unique_ptr<OneMap> host_ = std::make_unique<OneMap>();  ///< of which TBB may throw in the end
  NanoVdbMirror facts_{backend_->makeArena(), 0.02};
  PretendedFuser* fuser_ = nullptr;
  std::unique_ptr<LeadingMap> lead_;
};

TEST_F(LeadingMapTest, TheHostGetsEveryScanAndTheMirrorEveryNode) {
  for (std::size_t n = 0; n < scans_.size(); ++n) {
    if (n % 3 == 0) lead_->prepare(scans_[n].p_L, scans_[n].q_L);
    EXPECT_TRUE(fuse(n));
    if (n % 5 != 4) continue;
    lead_->catchUp();
    expectScans(n + 1);
    EXPECT_EQ(facts_.leafCount(), host_->map.leaf_count);
  }
  lead_->catchUp();
  expectScans(scans_.size());
  EXPECT_EQ(facts_.leafCount(), host_->map.leaf_count);
  EXPECT_TRUE(lead_->leads());
  EXPECT_TRUE(lead_->pays());
}

/// Oracle: each leaf of the map by itself.
TEST_F(LeadingMapTest, BeginsWithWhatTheMapHolds) {
  EXPECT_TRUE(fuser_->begun.with_values.empty());
  lead_.reset();
  OneMap before;
  before.map.blockNewThings(0.06f);
  for (const LedScan& scan : scans_) before.integrator.integrate(scan.p_L, scan.q_L);
  for (int n = 0; n < 3; ++n) {  // something stands where nothing was
    LedScan closer = scans_[0];
    for (Eigen::Vector3f& p_L : closer.p_L) p_L.z() += 0.2f;
    before.integrator.integrate(closer.p_L, closer.q_L);
  }
  auto fuser = std::make_unique<PretendedFuser>(scans_);
  const HeldByMap& begun = (fuser_ = fuser.get())->begun;
  lead_ = std::make_unique<LeadingMap>(std::move(fuser), before.map, before.integrator, facts_, smallMap());
  const std::set<Origin> with_values(begun.with_values.begin(), begun.with_values.end());
  EXPECT_EQ(with_values.size(), begun.with_values.size());
  std::size_t without = 0, voted = 0;
  for (auto leaf = before.map.tree().cbeginLeaf(); leaf; ++leaf) {
    const openvdb::Coord& ijk = leaf->origin();
    const Origin origin = {ijk.x(), ijk.y(), ijk.z()};
    EXPECT_EQ(with_values.contains(origin), static_cast<bool>(LeafValues(*leaf)));
    without += with_values.contains(origin) ? 0 : 1;
    const VoxelVotes* const votes = before.map.votesOf(*leaf);
    const auto told = std::ranges::find(begun.votes, origin, &kernels::VotesRecord::origin_ijk);
    ASSERT_EQ(told != begun.votes.end(), votes != nullptr);
    if (votes == nullptr) continue;
    ++voted;
    for (std::size_t voxel = 0; voxel < 512; ++voxel) {
      for (std::size_t bit = 0; bit < 3; ++bit) {
        EXPECT_EQ(told->votes[16 * bit + voxel / 32] >> voxel % 32 & 1u,
                  votes->bit[bit][voxel / 64] >> voxel % 64 & 1u);
      }
    }
  }
  EXPECT_GT(with_values.size(), 100u);
  EXPECT_GT(without, 10u);
  EXPECT_GT(voted, 5u);
  EXPECT_EQ(voted, begun.votes.size());
  lead_.reset();
}

TEST_F(LeadingMapTest, NoRoomLeavesTheScanToTheHost) {
  for (std::size_t n = 0; n < 3; ++n) EXPECT_TRUE(fuse(n));
  fuser_->act = [](FollowingMap&) { throw ResourceLimit("memory.device", "cuda", "made up", ""); };
  EXPECT_FALSE(fuse(3));
  EXPECT_FALSE(lead_->leads());
  expectScans(3);
  EXPECT_EQ(facts_.leafCount(), host_->map.leaf_count);
}

TEST_F(LeadingMapTest, AScanOfAFailedDeviceIsInTheHostsMap) {
  for (std::size_t n = 0; n < 3; ++n) EXPECT_TRUE(fuse(n));
  fuser_->act = [](FollowingMap&) { throw DeviceError("device.failed", "cuda", "made up", ""); };
  EXPECT_EQ(errorOf(3), "device.failed");
  EXPECT_FALSE(lead_->leads());
  expectScans(4);
}

TEST_F(LeadingMapTest, MapsThatDifferAreFoundAndTheHostsMapIsWhole) {
  for (std::size_t n = 0; n < 2; ++n) EXPECT_TRUE(fuse(n));
  fuser_->diverges = true;
  std::size_t n = 2;
  for (; !lead_->diverged() && n < 2 + 2 * MapFollower::kMostBehind; ++n) EXPECT_TRUE(fuse(n));
  EXPECT_TRUE(lead_->diverged());
  lead_->catchUp();
  expectScans(n);
}

/// It is known before anybody gets an answer, though no scan follows that would tell.
TEST_F(LeadingMapTest, MapsThatDifferInTheLastScanAreFoundWhenTheHostCatchesUp) {
  for (std::size_t n = 0; n < 2; ++n) EXPECT_TRUE(fuse(n));
  lead_->catchUp();
  EXPECT_FALSE(lead_->diverged());
  fuser_->diverges = true;
  EXPECT_TRUE(fuse(2));
  lead_->catchUp();
  EXPECT_TRUE(lead_->diverged());
  expectScans(3);
}

TEST_F(LeadingMapTest, MapsThatDifferAreFoundWhereTheDeviceHasNoRoom) {
  EXPECT_TRUE(fuse(0));
  fuser_->diverges = true;
  EXPECT_TRUE(fuse(1));
  fuser_->act = [](FollowingMap&) { throw ResourceLimit("memory.device", "cuda", "made up", ""); };
  EXPECT_FALSE(fuse(2));
  EXPECT_FALSE(lead_->leads());
  EXPECT_TRUE(lead_->diverged());
  expectScans(2);
}

TEST_F(LeadingMapTest, DoesNotPayWhereMostValuesComeBack) {
  fuser_->act = [&](FollowingMap& host) {
    host.wait();
    std::vector<kernels::LeafRecord> leaves;
    for (auto leaf = host_->map.tree().cbeginLeaf(); leaf; ++leaf) {
      const openvdb::Coord& origin = leaf->origin();
      if (LeafValues(*leaf)) leaves.emplace_back().origin_ijk = {origin.x(), origin.y(), origin.z()};
    }
    host.read(leaves);
    fuser_->returned = leaves.size();
    for (const kernels::LeafRecord& record : leaves) {
      const PackedLeaf* leaf =
          host_->map.tree().probeConstLeaf({record.origin_ijk[0], record.origin_ijk[1], record.origin_ijk[2]});
      LeafValues::Room room;
      const std::uint32_t* values = LeafValues(*leaf).all(room);
      EXPECT_TRUE(std::equal(values, values + 512, record.values));
    }
  };
  std::size_t n = 0;
  for (; n < scans_.size() && lead_->pays(); ++n) EXPECT_TRUE(fuse(n));
  EXPECT_GE(n, static_cast<std::size_t>(ReturningValues::kMostScans));
  EXPECT_FALSE(lead_->pays());
  lead_->stop();
  expectScans(n);
}

TEST_F(LeadingMapTest, WeightsAreThoseOfAllScansWhoeverReadsThem) {
  for (std::size_t n = 0; n < 5; ++n) EXPECT_TRUE(fuse(n));
  OneMap expected;
  for (std::size_t n = 0; n < 5; ++n) expected.integrator.integrate(scans_[n].p_L, scans_[n].q_L);
  std::vector<Index3> voxels;
  for (const Eigen::Vector3f& p : scans_[4].p_L) {
    voxels.push_back({static_cast<std::int32_t>(std::floor(p.x() / 0.02f + 0.5f)),
                      static_cast<std::int32_t>(std::floor(p.y() / 0.02f + 0.5f)),
                      static_cast<std::int32_t>(std::floor(p.z() / 0.02f + 0.5f))});
  }
  std::vector<std::uint16_t> wanted(voxels.size());
  readWeightsOfMap(expected.map, 1, voxels, wanted);
  EXPECT_GT(*std::max_element(wanted.begin(), wanted.end()), 0);
  for (const bool fails : {false, true}) {
    fuser_->weights_fail = fails ? "device.failed" : "";
    std::vector<std::uint16_t> weights(voxels.size());
    lead_->readWeightsAt(voxels, 1, weights);
    EXPECT_EQ(weights, wanted);
    EXPECT_EQ(lead_->leads(), !fails);
  }
}

TEST_F(LeadingMapTest, WeightsOfAMapThatDiffersAreNotAnswered) {
  for (std::size_t n = 0; n < 3; ++n) EXPECT_TRUE(fuse(n));
  fuser_->weights_fail = "device.diverged";
  std::vector<std::uint16_t> weights(1);
  EXPECT_THROW(lead_->readWeightsAt(std::vector<Index3>(1), 1, weights), DeviceError);
  EXPECT_FALSE(lead_->leads());
  expectScans(3);
}

TEST_F(LeadingMapTest, AScanThatNeedsWhatTheHostsMapLacksIsLeftToTheHost) {
  for (std::size_t n = 0; n < 2; ++n) EXPECT_TRUE(fuse(n));
  fuser_->act = [](FollowingMap& host) {
    std::vector<kernels::LeafRecord> nowhere(1);
    nowhere[0].origin_ijk = {8000, 8000, 8000};
    host.wait();
    host.read(nowhere);
  };
  EXPECT_FALSE(fuse(2));
  EXPECT_TRUE(lead_->diverged());
  EXPECT_FALSE(lead_->leads());
  expectScans(2);
}

/// The mirror takes nothing from then on, but the host's map takes every scan.
TEST_F(LeadingMapTest, NodesThatAreThereAlreadyMakeTheMapsDiffer) {
  EXPECT_TRUE(fuse(0));
  fuser_->adds_again = true;
  std::size_t n = 1;
  for (; !lead_->diverged() && n < 2 + 2 * MapFollower::kMostBehind; ++n) EXPECT_TRUE(fuse(n));
  EXPECT_TRUE(lead_->diverged());
  lead_->catchUp();
  expectScans(n);
}

/// @return voxels of the map's leaves at which the mirror says something else than the map
std::size_t differencesBetween(const PackedMap& map, const Mirrors& mirrors) {
  std::size_t differences = 0;
  auto voxels = mirrors.grid()->getAccessor();
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) {
    const LeafChange facts = factsOf(map, *leaf);
    for (int n = 0; n < 512; ++n) {
      const std::size_t x = static_cast<std::size_t>(n) >> 6;
      const nanovdb::Coord at(facts.origin_ijk[0] + (n >> 6), facts.origin_ijk[1] + (n >> 3 & 7),
                              facts.origin_ijk[2] + (n & 7));
      const bool collides = (facts.collides_on[x] >> (n & 63) & 1u) != 0,
                 free = (facts.arm_free_on[x] >> (n & 63) & 1u) != 0;
      differences += voxels.getValue(at) != collides || voxels.isActive(at) != free ? 1 : 0;
    }
  }
  return differences;
}

TEST(MirrorsOfAMap, MadeAgainHaveTheFactsOfTheMapWhateverWasWritten) {
  const FieldParams params = smallMap();
  PackedMap map(params.tsdf);
  map.setCollisionDistance(0.01f);
  ScanIntegrator integrator(map);
  const std::unique_ptr<kernels::Backend> backend = kernels::makeCpuBackend();
  Mirrors mirrors(*backend, map, params);
  for (const LedScan& scan : scansOf(4)) {
    MapChangesOfScan changes;
    changes.fused = integrator.integrate(scan.p_L, scan.q_L);
    FrameStats stats;
    mirrors.take(changes, stats);
  }
  const std::uint64_t leaves = mirrors.facts().leafCount();
  EXPECT_EQ(differencesBetween(map, mirrors), 0u);
  EXPECT_GT(leaves, 100u);
  std::vector<LeafChange> wrong(2);
  const openvdb::Coord& origin = map.tree().cbeginLeaf()->origin();
  wrong[0].origin_ijk = {origin.x(), origin.y(), origin.z()};
  wrong[0].collides_on.fill(~std::uint64_t{0});
  wrong[1].origin_ijk = {8000, 8000, 8000};
  wrong[1].arm_free_on.fill(~std::uint64_t{0});
  mirrors.take(wrong, {});
  EXPECT_GT(differencesBetween(map, mirrors), 0u);
  mirrors.makeFactsAgain();
  EXPECT_EQ(differencesBetween(map, mirrors), 0u);
  EXPECT_EQ(mirrors.facts().leafCount(), leaves);
  EXPECT_FALSE(mirrors.grid()->tree().isActive(nanovdb::Coord(8000, 8000, 8000)));
}

}  // namespace
}  // namespace accessvdb::internal
