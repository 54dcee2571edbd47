// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The mirror of distances against an OpenVDB grid changed voxel by voxel, and against NanoVDB's own conversion of it;
// and its guarantees to an arena.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/distance_checks.h"
#include "parity/nanovdb_tools.h"
#include "parity/staged_arena.h"

namespace accessvdb::testing {
namespace {

using internal::DistanceMirror;
using kernels::DistanceGrid;
using kernels::HostArena;

constexpr auto kTiles = DistanceMirror::kDefaultRootCapacity;

::testing::AssertionResult answersLike(DistanceWorld& world, const DistanceGrid& mirror) {
  const auto converted_handle = convertedByNanoVdb(world.grid());
  const auto* converted = converted_handle.grid<float>();
  if (converted == nullptr) return ::testing::AssertionFailure() << "NanoVDB could not convert the oracle";
  auto mirror_voxels = mirror.getAccessor();
  auto converted_voxels = converted->getAccessor();
  std::uint64_t active_voxels = 0, differ = 0;
  openvdb::Coord first;
  world.forEachVoxel([&](const openvdb::Coord& ijk, float value, bool active) {
    const nanovdb::Coord at(ijk.x(), ijk.y(), ijk.z());
    float probed = -1;
    const bool same = mirror_voxels.getValue(at) == value && mirror_voxels.isActive(at) == active &&
                      mirror_voxels.probeValue(at, probed) == active && probed == value &&
                      converted_voxels.getValue(at) == value && converted_voxels.isActive(at) == active;
    if (!same && differ++ == 0) first = ijk;
  });
  if (differ > 0) return ::testing::AssertionFailure() << differ << " voxels differ, first " << first;
  active_voxels = world.grid().activeVoxelCount();
  const TreeCensus census = walkTree(mirror);
  if (!census.problem.empty()) return ::testing::AssertionFailure() << census.problem;
  if (census.active_voxels != active_voxels) {
    return ::testing::AssertionFailure() << "the mirror has " << census.active_voxels << " active voxels, not "
                                         << active_voxels;
  }
  const std::string error = problemByNanoVdb(mirror);
  if (!error.empty()) return ::testing::AssertionFailure() << error;
  return ::testing::AssertionSuccess();
}

std::unique_ptr<DistanceMirror> mirrorIn(std::unique_ptr<kernels::MirrorArena> arena, std::uint32_t tiles = kTiles) {
  return std::make_unique<DistanceMirror>(std::move(arena), 0.01, tiles, DistanceWorld::leaves());
}

/// Changed in place as on the CPU, or in batches as on a device.
class DistancesEqualOpenVdb : public ::testing::TestWithParam<bool> {
 protected:
  static std::unique_ptr<DistanceMirror> makeMirror(std::uint64_t reserve_bytes = HostArena::kDefaultReserveBytes,
                                                    std::uint32_t tiles = kTiles) {
    if (GetParam()) return mirrorIn(std::make_unique<StagedArena>(reserve_bytes), tiles);
    return mirrorIn(std::make_unique<HostArena>(reserve_bytes), tiles);
  }
};
INSTANTIATE_TEST_SUITE_P(Arenas, DistancesEqualOpenVdb, ::testing::Bool(),
                         [](const auto& kind) { return kind.param ? "Staged" : "InPlace"; });

TEST_P(DistancesEqualOpenVdb, AnEmptyMirrorIsAllBackground) {
  DistanceWorld world(1);
  const auto mirror = makeMirror();
  EXPECT_TRUE(answersLike(world, *mirror->grid()));
  EXPECT_EQ(mirror->grid()->gridType(), nanovdb::GridType::Float);
  EXPECT_STREQ(mirror->grid()->gridName(), "distance");
  EXPECT_EQ(mirror->grid()->voxelSize(), nanovdb::Vec3d(0.01));
  EXPECT_EQ(mirror->grid()->tree().background(), DistanceWorld::kBackground_m);
  EXPECT_EQ(mirror->grid()->tree().getValue(nanovdb::Coord(1, -2, 3)), DistanceWorld::kBackground_m);
  mirror->apply({});
  EXPECT_EQ(mirror->lastTraffic().bytes_written, 0u);
}

/// Octants of both signs, both sides of root tiles, growth over many chunks of leaves.
TEST_P(DistancesEqualOpenVdb, FollowsRoundsOfRandomChanges) {
  DistanceWorld world(2);
  const auto mirror = makeMirror();
  const DistanceGrid* address = mirror->grid();
  std::map<std::array<std::int32_t, 3>, const void*> leaves;
  for (int round = 0; round < 16; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    const auto changes = world.batch(150);
    mirror->apply(changes);
    ASSERT_EQ(mirror->grid(), address);
    if (round % 3 == 0 || round == 15) {
      ASSERT_TRUE(answersLike(world, *mirror->grid()));
    }
    for (const DistanceChange& change : changes) {
      const auto& [x, y, z] = change.origin_ijk;
      const void* leaf = mirror->grid()->tree().root().probeLeaf(nanovdb::Coord(x, y, z));
      if (leaf != nullptr) leaves.emplace(change.origin_ijk, leaf);
    }
    for (const auto& [origin, leaf] : leaves) {
      ASSERT_EQ(mirror->grid()->tree().root().probeLeaf(nanovdb::Coord(origin[0], origin[1], origin[2])), leaf);
    }
    const TreeCensus census = walkTree(*mirror->grid());
    ASSERT_EQ(census.leaves, mirror->leafCount());
    ASSERT_EQ(census.leaves, mirror->grid()->tree().nodeCount(0));
    ASSERT_EQ(census.lowers, mirror->grid()->tree().nodeCount(1));
    ASSERT_EQ(census.uppers, mirror->rootTileCount());
  }
  EXPECT_GT(mirror->rootTileCount(), 100u);
  EXPECT_GT(mirror->leafCount(), 1024u);  // more than two chunks
}

TEST_P(DistancesEqualOpenVdb, ALeafMayComeTwiceInOneCall) {
  DistanceWorld world(4);
  const auto mirror = makeMirror();
  for (int round = 0; round < 3; ++round) {
    std::vector<DistanceChange> changes;
    for (int n = 0; n < 200; ++n) {
      changes.push_back(world.change({8 * static_cast<int>(world.maker().below(20)) - 80, -8, 0}));
    }
    mirror->apply(changes);
    ASSERT_TRUE(answersLike(world, *mirror->grid()));
    ASSERT_LE(mirror->lastTraffic().leaves_patched + mirror->lastTraffic().leaves_added, 20u);
  }
}

TEST_P(DistancesEqualOpenVdb, TooManyRootTilesIsAnErrorThatChangesNothing) {
  DistanceWorld world(6);
  const auto mirror = makeMirror(HostArena::kDefaultReserveBytes, 3);
  std::vector<DistanceChange> changes;
  for (const std::int32_t x : {-4096, 0, 4096}) changes.push_back(world.change({x, 0, 0}));
  for (DistanceChange& change : changes) change.row_pairs = ~0u;
  mirror->apply(changes);
  ASSERT_TRUE(answersLike(world, *mirror->grid()));
  const TreeCensus before = walkTree(*mirror->grid());
  auto too_many = changes;
  too_many.push_back(changes[0]);
  too_many.back().origin_ijk = {8, 8, 8};
  too_many.push_back(changes[0]);
  too_many.back().origin_ijk = {0, 4096, 0};
  for (int attempt = 0; attempt < 2; ++attempt) {
    try {
      mirror->apply(too_many);
      FAIL() << "a fourth root tile fitted into three";
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "map.root_tiles");
      EXPECT_EQ(error.exitCode(), 5);
    }
    EXPECT_EQ(walkTree(*mirror->grid()).leaves, before.leaves);
    EXPECT_TRUE(answersLike(world, *mirror->grid()));
  }
}

TEST_P(DistancesEqualOpenVdb, AFullArenaIsAnErrorThatChangesNothing) {
  DistanceWorld world(7);
  const auto mirror = makeMirror(std::uint64_t(32) << 20);
  bool full = false;
  for (int round = 0; round < 50 && !full; ++round) {
    const TreeCensus before = walkTree(*mirror->grid());
    const auto changes = world.batch(20);
    try {
      mirror->apply(changes);
      if (round % 8 == 0) {
        ASSERT_TRUE(answersLike(world, *mirror->grid()));
      }
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "memory.mirror_reserve");
      full = true;
      const TreeCensus after = walkTree(*mirror->grid());
      EXPECT_EQ(after.problem, "");
      EXPECT_EQ(after.leaves, before.leaves);
      EXPECT_EQ(after.active_voxels, before.active_voxels);
    }
  }
  EXPECT_TRUE(full);
  EXPECT_LE(mirror->usedBytes(), std::uint64_t(32) << 20);
}

/// What the host adds after an adoption must not fill an adopted chunk with background.
TEST(DistanceMirrorContract, AdoptedLeavesKeepTheirDistances) {
  DistanceWorld world(17);
  const auto mirror = mirrorIn(std::make_unique<HostArena>());
  const auto leafAt = [](std::uint32_t n) {  // in one lower node
    return std::array<std::int32_t, 3>{8 * static_cast<int>(n >> 8), 8 * static_cast<int>(n >> 4 & 15),
                                       8 * static_cast<int>(n & 15)};
  };
  const auto add = [&](std::uint32_t n) {
    while (mirror->leafCount() == n) {  // some changes have no rows
      const DistanceChange change = world.change(leafAt(n));
      mirror->apply({&change, 1});
    }
  };
  for (std::uint32_t n = 0; n < 512; ++n) add(n);  // a full chunk
  const kernels::GridSpace space = mirror->space();
  const auto origin = leafAt(512);
  mirror->reserve(kernels::growthBytes(space, {0, 0, 1}));

  auto* memory = reinterpret_cast<std::byte*>(const_cast<DistanceGrid*>(mirror->grid()));
  auto* chunk = reinterpret_cast<kernels::DistanceLeaf::DataType*>(memory + space.top_bytes);
  for (int n = 0; n < 512; ++n) std::fill_n(chunk[n].mValues, 512, DistanceWorld::kBackground_m);
  chunk->mBBoxMin = nanovdb::Coord(origin[0], origin[1], origin[2]);
  chunk->mValues[7] = 0.25f;
  chunk->mValueMask.setOn(7);
  auto& root = const_cast<DistanceGrid*>(mirror->grid())->tree().root();
  auto* lower = root.data()->getChild(root.data()->tile(0))->data()->getChild(0)->data();
  lower->mChildMask.setOn(512);
  lower->setChild(512, chunk);
  ASSERT_EQ(nanovdb::NanoLower<float>::CoordToOffset(chunk->mBBoxMin), 512u);
  mirror->adopt({{}, {}, {&origin, 1}});

  EXPECT_EQ(mirror->usedBytes(), space.top_bytes + 512 * 2144);
  add(513);
  const auto& tree = mirror->grid()->tree();
  EXPECT_EQ(tree.getValue(chunk->mBBoxMin + nanovdb::Coord(0, 0, 7)), 0.25f);
  EXPECT_EQ(tree.getValue(chunk->mBBoxMin), DistanceWorld::kBackground_m);
  EXPECT_EQ(tree.root().probeLeaf(nanovdb::Coord(16, 0, 8))->data(), chunk + 1);
  EXPECT_EQ(walkTree(*mirror->grid()).leaves, 514u);
}

TEST(DistanceMirrorContract, TheGridIsSoundAfterEverySingleWrite) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  const auto mirror = mirrorIn(std::move(owned));
  DistanceWorld world(8);
  int writes = 0;
  arena.after_write = [&](std::uint64_t, std::uint64_t) {
    if (++writes % 97 == 0) {
      ASSERT_EQ(walkTree(*mirror->grid()).problem, "");
    }
  };
  for (int round = 0; round < 4 && !HasFatalFailure(); ++round) mirror->apply(world.batch(15));
  EXPECT_GT(writes, 5000);
}

TEST(DistanceMirrorContract, NoByteIsWrittenTwiceBetweenFlushes) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  const auto mirror = mirrorIn(std::move(owned));
  std::set<std::uint64_t> written;  // words
  int overlaps = 0;
  arena.after_write = [&](std::uint64_t offset, std::uint64_t bytes) {
    for (std::uint64_t word = offset / 4; word < (offset + bytes + 3) / 4; ++word) {
      if (!written.insert(word).second) ++overlaps;
    }
  };
  arena.after_flush = [&] { written.clear(); };
  DistanceWorld world(9);
  for (int round = 0; round < 6; ++round) {
    auto changes = world.batch(200);
    const auto again = changes;
    if (round % 2 == 0) changes.insert(changes.end(), again.begin(), again.end());
    mirror->apply(changes);
    ASSERT_EQ(overlaps, 0);
  }
  EXPECT_GT(arena.batches, 10u);
}

/// Of a leaf's 2 KB, only the changed rows are sent: 12 B and 64 B per pair of rows.
TEST(DistanceMirrorContract, OnlyChangedRowsTravel) {
  auto owned = std::make_unique<StagedArena>(HostArena::kDefaultReserveBytes, 1u << 20);
  const StagedArena& arena = *owned;
  const auto mirror = mirrorIn(std::move(owned));
  DistanceWorld world(10);
  std::vector<DistanceChange> changes;
  for (int n = 0; n < 100; ++n) changes.push_back(world.change({8 * n, 0, 0}));
  mirror->apply(changes);
  const std::uint64_t before = arena.sent_bytes;
  for (DistanceChange& change : changes) change.row_pairs = 1u << 5 | 1u << 31;
  mirror->apply(changes);
  EXPECT_EQ(mirror->lastTraffic().leaves_patched, 100u);
  EXPECT_EQ(mirror->lastTraffic().bytes_written, 100u * (12 + 2 * 64));
  EXPECT_LT(arena.sent_bytes - before, mirror->lastTraffic().bytes_written + 64);
  for (DistanceChange& change : changes) change.row_pairs = 0;
  mirror->apply(changes);
  for (DistanceChange& change : changes) change.origin_ijk[1] = 800;  // leaves that do not exist
  mirror->apply(changes);
  EXPECT_EQ(mirror->leafCount(), 100u);
}

TEST(DistanceMirrorContract, StagedOrInPlaceTheMemoryHoldsTheSameBytes) {
  const auto in_place = mirrorIn(std::make_unique<HostArena>()), staged = mirrorIn(std::make_unique<StagedArena>());
  DistanceWorld world(11);
  for (int round = 0; round < 5; ++round) {
    std::vector<DistanceChange> changes;
    for (int x = -8; x < 8; ++x) {
      for (int y = -8; y < 8; ++y) {
        for (int z = -6; z < 6; ++z) {
          if (world.maker().below(3) == 0) {
            changes.push_back(world.change({8 * x + 4096 * (round % 3 - 1), 8 * y, 8 * z}));
          }
        }
      }
    }
    std::vector<std::span<const DistanceChange>> parts;
    for (std::size_t at = 0; at < changes.size(); at += 333) {
      parts.push_back(
          std::span<const DistanceChange>(changes).subspan(at, std::min<std::size_t>(333, changes.size() - at)));
    }
    if (round >= 3) parts.push_back(parts.front());
    in_place->applyLists(parts);
    staged->applyLists(parts);
    ASSERT_GT(changes.size(), 800u);
    ASSERT_EQ(in_place->lastTraffic().leaves_added, staged->lastTraffic().leaves_added);
    ASSERT_EQ(in_place->lastTraffic().leaves_patched, staged->lastTraffic().leaves_patched);
    ASSERT_EQ(in_place->usedBytes(), staged->usedBytes());
    ASSERT_EQ(std::memcmp(in_place->grid(), staged->grid(), in_place->usedBytes()), 0);
  }
  ASSERT_TRUE(answersLike(world, *staged->grid()));
}

/// Memory that runs out at any point of a frame: nothing new becomes readable, and the same frame succeeds once there
/// is memory, including the background.
TEST(DistanceMirrorContract, WithoutMemoryNothingIsWritten) {
  int refused = 0;
  for (int fail_at = 0; fail_at < 3; ++fail_at) {
    SCOPED_TRACE(fail_at);
    auto owned = std::make_unique<StagedArena>();
    StagedArena& arena = *owned;
    const auto mirror = mirrorIn(std::move(owned));
    DistanceWorld world(13);
    mirror->apply(world.batch(50));
    const TreeCensus before = walkTree(*mirror->grid());
    const std::uint64_t sent = arena.sent_bytes;
    std::vector<DistanceChange> far;  // one lower node each, and root tiles: the arena has to grow repeatedly
    for (int n = 0; n < 2400; ++n) far.push_back(world.change({4096 * (n % 400) + 128 * n, 4096 * 3, 8}));
    int commits = 0;
    arena.before_commit = [&] {
      if (commits++ == fail_at) throw ResourceLimit("memory.device", "cuda", "none left", "Free some");
    };
    try {
      mirror->apply(far);
    } catch (const ResourceLimit&) {
      ++refused;
      ASSERT_EQ(arena.sent_bytes, sent);
      ASSERT_EQ(walkTree(*mirror->grid()).active_voxels, before.active_voxels);
      ASSERT_EQ(walkTree(*mirror->grid()).leaves, before.leaves);
      mirror->apply(far);
    }
    ASSERT_TRUE(answersLike(world, *mirror->grid()));
  }
  EXPECT_GT(refused, 1);
}

/// Single writes are gathered in a list begun earlier, but not across a fill.
TEST(DistanceMirrorContract, AFillComesBeforeWhatIsWrittenAfterIt) {
  StagedArena arena;
  arena.commit(4096);
  const std::uint32_t early = 1, late = 2;
  arena.write(0, &early, 4);
  const kernels::ArenaFill fills[] = {{256, 64, 96, 3, 7}, {0, 4, 0, 1, 9}};
  arena.stageFills(fills);
  arena.write(260, &late, 4);
  arena.flush();
  const auto* words = static_cast<const std::uint32_t*>(arena.base());
  for (std::uint32_t n = 0; n < 1024; ++n) {
    std::uint32_t expected = n == 0 ? 9 : 0;
    if (n >= 64 && n < 136 && (n - 64) % 24 < 16) expected = n == 65 ? late : 7;
    ASSERT_EQ(words[n], expected) << n;
  }
}

TEST(DistanceMirrorContract, AfterAWriteThatFailedNothingIsTakenAnyMore) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  const auto mirror = mirrorIn(std::move(owned));
  DistanceWorld world(12);
  mirror->apply(world.batch(50));
  arena.before_send = [] { throw DeviceError("device.failed", "cuda", "lost", "Check the GPU"); };
  EXPECT_THROW(mirror->apply(world.batch(50)), DeviceError);
  arena.before_send = nullptr;
  EXPECT_THROW(mirror->apply(world.batch(50)), InternalError);
}

}  // namespace
}  // namespace accessvdb::testing
