// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The mirror against an OpenVDB grid changed voxel by voxel, and against NanoVDB's own conversion of it.
#include <gtest/gtest.h>
#include <algorithm>
#include <map>
#include <set>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/mirror_checks.h"
#include "parity/nanovdb_tools.h"
#include "parity/staged_arena.h"
#include "vdb/standard_grids.h"

namespace accessvdb::testing {
namespace {

using internal::NanoVdbMirror;
using kernels::HostArena;
using kernels::OccupancyGrid;

bool bitOf(const LeafBits& bits, int x, int y, int z) {
  const int n = (x << 6) | (y << 3) | z;
  return (bits[n / 64] >> (n % 64)) & 1;
}

class Oracle {
 public:
  Oracle() { openvdb::initialize(); }

  void apply(const std::vector<LeafChange>& changes) {
    auto voxels = grid_->getAccessor();
    for (const LeafChange& change : changes) {
      const openvdb::Coord origin(change.origin_ijk.data());
      for (int x = 0; x < 8; ++x) {
        for (int y = 0; y < 8; ++y) {
          for (int z = 0; z < 8; ++z) {
            const openvdb::Coord ijk = origin.offsetBy(x, y, z);
            if (bitOf(change.collides_on, x, y, z)) voxels.setValueOnly(ijk, true);
            if (bitOf(change.collides_off, x, y, z)) voxels.setValueOnly(ijk, false);
            if (bitOf(change.arm_free_on, x, y, z)) voxels.setActiveState(ijk, true);
            if (bitOf(change.arm_free_off, x, y, z)) voxels.setActiveState(ijk, false);
          }
        }
      }
    }
  }

  /// Every voxel of every leaf of the oracle, then random voxels, most of them background.
  [[nodiscard]] ::testing::AssertionResult answersLike(const OccupancyGrid& mirror, ChangeMaker& maker) const {
    const auto converted_handle = convertedByNanoVdb(*grid_);
    const auto* converted = converted_handle.grid<bool>();
    if (converted == nullptr) return ::testing::AssertionFailure() << "NanoVDB could not convert the oracle";
    auto oracle_voxels = grid_->getConstAccessor();
    auto mirror_voxels = mirror.getAccessor();
    auto converted_voxels = converted->getAccessor();
    const auto same = [&](const openvdb::Coord& ijk) {
      const nanovdb::Coord at(ijk.x(), ijk.y(), ijk.z());
      const bool value = oracle_voxels.getValue(ijk), active = oracle_voxels.isValueOn(ijk);
      bool probed = !value;
      return mirror_voxels.getValue(at) == value && mirror_voxels.isActive(at) == active &&
             mirror_voxels.probeValue(at, probed) == active && probed == value &&
             converted_voxels.getValue(at) == value && converted_voxels.isActive(at) == active;
    };
    std::uint64_t true_voxels = 0, active_voxels = 0;
    for (auto leaf = grid_->tree().cbeginLeaf(); leaf; ++leaf) {
      for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) {
        true_voxels += *voxel;
        active_voxels += voxel.isValueOn();
        if (!same(voxel.getCoord())) return ::testing::AssertionFailure() << "differs at " << voxel.getCoord();
      }
    }
    for (int i = 0; i < 20000; ++i) {
      const auto origin = maker.origin();
      const openvdb::Coord ijk(origin[0] + static_cast<int>(maker.below(300)) - 150,
                               origin[1] + static_cast<int>(maker.below(300)) - 150,
                               origin[2] + static_cast<int>(maker.below(300)) - 150);
      if (!same(ijk)) return ::testing::AssertionFailure() << "differs at the random voxel " << ijk;
    }
    const TreeCensus census = walkTree(mirror);
    if (!census.problem.empty()) return ::testing::AssertionFailure() << census.problem;
    if (census.true_voxels != true_voxels || census.active_voxels != active_voxels) {
      return ::testing::AssertionFailure() << "the mirror holds bits that the oracle does not";
    }
    const std::string error = problemByNanoVdb(mirror);
    if (!error.empty()) return ::testing::AssertionFailure() << error;
    return ::testing::AssertionSuccess();
  }

 private:
  openvdb::BoolGrid::Ptr grid_ = openvdb::BoolGrid::create(false);
};

/// Changed in place as on the CPU, or in batches as on a device.
class MirrorEqualsOpenVdb : public ::testing::TestWithParam<bool> {
 protected:
  static std::unique_ptr<kernels::MirrorArena> makeArena(
      std::uint64_t reserve_bytes = HostArena::kDefaultReserveBytes) {
    if (GetParam()) return std::make_unique<StagedArena>(reserve_bytes);
    return std::make_unique<HostArena>(reserve_bytes);
  }
};
INSTANTIATE_TEST_SUITE_P(Arenas, MirrorEqualsOpenVdb, ::testing::Bool(),
                         [](const auto& kind) { return kind.param ? "Staged" : "InPlace"; });

TEST_P(MirrorEqualsOpenVdb, AnEmptyMirrorIsAllBackground) {
  Oracle oracle;
  ChangeMaker maker(1);
  NanoVdbMirror mirror(makeArena(), 0.01);
  EXPECT_TRUE(oracle.answersLike(*mirror.grid(), maker));
  EXPECT_EQ(mirror.grid()->gridType(), nanovdb::GridType::Boolean);
  EXPECT_EQ(mirror.grid()->voxelSize(), nanovdb::Vec3d(0.01));
  EXPECT_NEAR(mirror.grid()->indexToWorld(nanovdb::Vec3d(3, -4, 5))[1], -0.04, 1e-15);
  mirror.apply({});
  EXPECT_EQ(mirror.lastTraffic().bytes_written, 0u);
}

TEST_P(MirrorEqualsOpenVdb, FollowsRoundsOfRandomChanges) {
  Oracle oracle;
  ChangeMaker maker(2);
  NanoVdbMirror mirror(makeArena(), 0.01);
  const OccupancyGrid* address = mirror.grid();
  std::map<std::array<std::int32_t, 3>, const void*> leaves;
  for (int round = 0; round < 24; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    const auto changes = maker.batch(250);
    mirror.apply(changes);
    oracle.apply(changes);
    ASSERT_EQ(mirror.grid(), address);
    ASSERT_TRUE(oracle.answersLike(*mirror.grid(), maker));
    for (const LeafChange& change : changes) {
      const auto& [x, y, z] = change.origin_ijk;
      const void* leaf = mirror.grid()->tree().root().probeLeaf(nanovdb::Coord(x, y, z));
      if (leaf != nullptr) leaves.emplace(change.origin_ijk, leaf);
    }
    for (const auto& [origin, leaf] : leaves) {
      ASSERT_EQ(mirror.grid()->tree().root().probeLeaf(nanovdb::Coord(origin[0], origin[1], origin[2])), leaf);
    }
    const TreeCensus census = walkTree(*mirror.grid());
    ASSERT_EQ(census.leaves, mirror.leafCount());
    ASSERT_EQ(census.leaves, mirror.grid()->tree().nodeCount(0));
    ASSERT_EQ(census.lowers, mirror.grid()->tree().nodeCount(1));
    ASSERT_EQ(census.uppers, mirror.rootTileCount());
  }
  EXPECT_GT(mirror.rootTileCount(), 100u);  // 27 around the origin and the far ones
  EXPECT_GT(mirror.leafCount(), 1500u);
}

TEST_P(MirrorEqualsOpenVdb, OrderAndSplitOfTheChangesDoNotMatter) {
  Oracle oracle;
  ChangeMaker maker(3);
  std::vector<LeafChange> changes;
  std::set<std::array<std::int32_t, 3>> seen;
  while (changes.size() < 1500) {
    const auto origin = maker.origin();
    if (seen.insert(origin).second) changes.push_back(maker.change(origin));
  }
  oracle.apply(changes);
  for (int order = 0; order < 4; ++order) {
    NanoVdbMirror mirror(makeArena(), 0.01);
    std::shuffle(changes.begin(), changes.end(), maker.random());
    const std::size_t split = maker.below(changes.size());
    mirror.apply({changes.data(), split});
    mirror.apply({changes.data() + split, changes.size() - split});
    EXPECT_TRUE(oracle.answersLike(*mirror.grid(), maker));
  }
}

TEST_P(MirrorEqualsOpenVdb, ALeafMayComeTwiceInOneCall) {
  Oracle oracle;
  ChangeMaker maker(4);
  NanoVdbMirror mirror(makeArena(), 0.01);
  for (int round = 0; round < 3; ++round) {
    std::vector<LeafChange> changes;
    for (int i = 0; i < 300; ++i) changes.push_back(maker.change({8 * static_cast<int>(maker.below(20)) - 80, -8, 0}));
    mirror.apply(changes);
    oracle.apply(changes);
    ASSERT_TRUE(oracle.answersLike(*mirror.grid(), maker));
    ASSERT_LE(mirror.lastTraffic().leaves_patched + mirror.lastTraffic().leaves_added, 20u);
  }
}

/// A leaf added by one change, while others in the same call bring no bits to it: they count, wherever they are.
TEST_P(MirrorEqualsOpenVdb, ChangesThatBringNothingCountWhereAnotherAddsTheLeaf) {
  for (const bool before : {false, true}) {
    Oracle oracle;
    ChangeMaker maker(14);
    NanoVdbMirror mirror(makeArena(), 0.01);
    LeafChange adds, takes;
    adds.origin_ijk = takes.origin_ijk = {-8, 16, 8};
    adds.collides_on[2] = 0xFF;
    adds.arm_free_on[4] = 0xF0;
    takes.collides_off[2] = 0x0F;
    takes.arm_free_off[4] = 0x10;
    LeafChange other = adds;
    other.origin_ijk = {0, 0, 0};
    const std::vector<LeafChange> changes = before ? std::vector{takes, other, adds} : std::vector{adds, other, takes};
    mirror.apply(changes);
    oracle.apply(changes);
    EXPECT_TRUE(oracle.answersLike(*mirror.grid(), maker));
    EXPECT_EQ(mirror.leafCount(), 2u);
  }
}

TEST_P(MirrorEqualsOpenVdb, BitsThatWentOffComeBack) {
  ChangeMaker maker(5);
  NanoVdbMirror mirror(makeArena(), 0.01);
  for (int round = 0; round < 3; ++round) {
    Oracle oracle;
    auto changes = maker.batch(200);
    mirror.apply(changes);
    oracle.apply(changes);
    ASSERT_TRUE(oracle.answersLike(*mirror.grid(), maker));
    const std::uint64_t leaves = mirror.leafCount();
    for (LeafChange& change : changes) {
      for (auto* bits : {&change.collides_off, &change.arm_free_off}) bits->fill(~std::uint64_t(0));
    }
    mirror.apply(changes);
    EXPECT_EQ(mirror.leafCount(), leaves);
    ASSERT_TRUE(Oracle().answersLike(*mirror.grid(), maker));
  }
}

TEST_P(MirrorEqualsOpenVdb, TooManyRootTilesIsAnErrorThatChangesNothing) {
  Oracle oracle;
  ChangeMaker maker(6);
  NanoVdbMirror mirror(makeArena(), 0.01, 3);
  std::vector<LeafChange> changes;
  for (const std::int32_t x : {-4096, 0, 4096}) {
    changes.push_back(maker.change({x, 0, 0}));
    changes.back().collides_on[0] = ~std::uint64_t(0);
    changes.back().collides_off[0] = 0;
  }
  mirror.apply(changes);
  oracle.apply(changes);
  ASSERT_EQ(mirror.rootTileCount(), 3u);

  auto too_many = changes;
  for (LeafChange& change : too_many) change.collides_off[0] = ~std::uint64_t(0);
  too_many.push_back(changes[0]);
  too_many.back().origin_ijk = {8, 8, 8};
  too_many.push_back(changes[0]);
  too_many.back().origin_ijk = {0, 4096, 0};
  for (int attempt = 0; attempt < 2; ++attempt) {
    try {
      mirror.apply(too_many);
      FAIL() << "a fourth root tile fitted into three";
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "map.root_tiles");
      EXPECT_EQ(error.exitCode(), 5);
      EXPECT_FALSE(error.advice().empty());
    }
    EXPECT_TRUE(oracle.answersLike(*mirror.grid(), maker));
  }
  too_many.pop_back();
  mirror.apply(too_many);
  oracle.apply(too_many);
  EXPECT_TRUE(oracle.answersLike(*mirror.grid(), maker));
}

TEST_P(MirrorEqualsOpenVdb, AFullArenaIsAnErrorThatChangesNothing) {
  Oracle oracle;
  ChangeMaker maker(7);
  NanoVdbMirror mirror(makeArena(std::uint64_t(8) << 20), 0.01);
  bool full = false;
  for (int round = 0; round < 50 && !full; ++round) {
    const auto changes = maker.batch(20);
    try {
      mirror.apply(changes);
      oracle.apply(changes);
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "memory.mirror_reserve");
      full = true;
    }
    ASSERT_TRUE(oracle.answersLike(*mirror.grid(), maker));
  }
  EXPECT_TRUE(full);
  EXPECT_LE(mirror.usedBytes(), std::uint64_t(8) << 20);
}

}  // namespace
}  // namespace accessvdb::testing
