// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the mirror guarantees to an arena (order of writes, no byte twice), and what the host arena guarantees to it.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <map>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/mirror_checks.h"
#include "parity/staged_arena.h"

namespace accessvdb::testing {
namespace {

using internal::NanoVdbMirror;
using kernels::HostArena;

/// Counts bytes written more than once since the last flush.
class OverlapWatch {
 public:
  explicit OverlapWatch(StagedArena& arena) {
    arena.after_write = [this](std::uint64_t offset, std::uint64_t bytes) {
      const auto next = written_.lower_bound(offset);
      if (next != written_.end() && next->first < offset + bytes) ++overlaps_;
      if (next != written_.begin() && std::prev(next)->second > offset) ++overlaps_;
      written_[offset] = offset + bytes;
    };
    arena.after_flush = [this] { written_.clear(); };
  }
  [[nodiscard]] int overlaps() const { return overlaps_; }

 private:
  int overlaps_ = 0;
  std::map<std::uint64_t, std::uint64_t> written_;  ///< begin to end
};

TEST(MirrorContract, TheGridIsSoundAfterEverySingleWrite) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  int writes = 0;
  arena.after_write = [&](std::uint64_t, std::uint64_t) {
    ++writes;
    ASSERT_EQ(walkTree(*mirror.grid()).problem, "");
  };
  ChangeMaker maker(8);
  for (int round = 0; round < 6 && !HasFatalFailure(); ++round) mirror.apply(maker.batch(25));
  EXPECT_GT(writes, 300);
}

TEST(MirrorContract, NoByteIsWrittenTwiceBetweenFlushes) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  const OverlapWatch watch(arena);
  ChangeMaker maker(9);
  for (int round = 0; round < 10; ++round) {
    auto changes = maker.batch(400);
    const auto again = changes;
    if (round % 2 == 0) changes.insert(changes.end(), again.begin(), again.end());  // leaves that occur twice
    mirror.apply(changes);
    ASSERT_EQ(watch.overlaps(), 0);
  }
  EXPECT_GT(arena.batches, 10u);
}

TEST(MirrorContract, ChangesWithoutEffectWriteNothing) {
  NanoVdbMirror mirror(std::make_unique<HostArena>(), 0.01);
  LeafChange change;
  change.origin_ijk = {-8, 0, 8};
  change.collides_off[0] = 3;
  mirror.apply({&change, 1});
  EXPECT_EQ(mirror.leafCount(), 0u);
  change.collides_on[0] = 3;  // off wins
  mirror.apply({&change, 1});
  EXPECT_EQ(mirror.leafCount(), 0u);
  change.collides_on[0] = 7;
  mirror.apply({&change, 1});
  EXPECT_EQ(mirror.lastTraffic().leaves_added, 1u);
  mirror.apply({&change, 1});
  EXPECT_EQ(mirror.lastTraffic().bytes_written, 0u);
  change.arm_free_on[7] = 1;
  mirror.apply({&change, 1});
  EXPECT_EQ(mirror.lastTraffic().leaves_patched, 1u);
  EXPECT_EQ(mirror.lastTraffic().leaves_added, 0u);
  EXPECT_EQ(mirror.lastTraffic().bytes_written, 8u);
}

/// Of the 272 bytes of a change, only the words that switch something are sent.
TEST(MirrorContract, OnlyWordsThatSwitchTravel) {
  auto owned = std::make_unique<StagedArena>();
  const StagedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  std::vector<LeafChange> changes(100);
  for (std::size_t n = 0; n < changes.size(); ++n) {
    changes[n].origin_ijk = {8 * static_cast<int>(n), 0, 0};
    changes[n].collides_on[3] = n + 1;
    changes[n].arm_free_on[5] = n + 1;
  }
  mirror.apply(changes);
  const std::uint64_t before = arena.sent_bytes;
  for (LeafChange& change : changes) std::swap(change.collides_on, change.collides_off);
  mirror.apply(changes);
  EXPECT_EQ(mirror.lastTraffic().leaves_patched, 100u);
  EXPECT_EQ(mirror.lastTraffic().bytes_written, 100u * (sizeof(kernels::LeafPatch) + 2 * 8));
  EXPECT_LT(arena.sent_bytes - before, mirror.lastTraffic().bytes_written + 64);
}

TEST(MirrorContract, ReuseOfTheSameLeavesTakesNoMoreMemory) {
  NanoVdbMirror mirror(std::make_unique<HostArena>(), 0.01);
  ChangeMaker maker(10);
  const auto on = maker.batch(100);
  auto off = on;
  for (LeafChange& change : off) {
    for (auto* bits : {&change.collides_off, &change.arm_free_off}) bits->fill(~std::uint64_t{0});
  }
  mirror.apply(on);
  mirror.apply(off);
  mirror.apply(on);
  const std::uint64_t used_bytes = mirror.usedBytes(), host_bytes = mirror.hostBytes();
  for (int round = 0; round < 50; ++round) {
    mirror.apply(off);
    mirror.apply(on);
  }
  EXPECT_EQ(mirror.usedBytes(), used_bytes);
  EXPECT_EQ(mirror.hostBytes(), host_bytes);
}

/// Many leaves, so that threads share them: each leaf once as in a scan, and joined scans in which some recur.
TEST(MirrorContract, StagedOrInPlaceTheMemoryHoldsTheSameBytes) {
  NanoVdbMirror in_place(std::make_unique<HostArena>(), 0.01), staged(std::make_unique<StagedArena>(), 0.01);
  ChangeMaker maker(11);
  for (int round = 0; round < 6; ++round) {
    std::vector<LeafChange> changes;
    for (int x = -16; x < 16; ++x) {
      for (int y = -16; y < 16; ++y) {
        for (int z = -6; z < 6; ++z) {
          if (maker.below(3) == 0) changes.push_back(maker.change({8 * x + 4096 * (round % 3 - 1), 8 * y, 8 * z}));
        }
      }
    }
    std::vector<std::span<const LeafChange>> parts;
    for (std::size_t at = 0; at < changes.size(); at += 333) {
      parts.push_back(
          std::span<const LeafChange>(changes).subspan(at, std::min<std::size_t>(333, changes.size() - at)));
    }
    if (round >= 4) parts.push_back(parts.front());
    in_place.applyLists(parts);
    staged.applyLists(parts);
    ASSERT_GT(changes.size(), 3000u);
    ASSERT_EQ(walkTree(*staged.grid()).problem, "");
    ASSERT_EQ(in_place.lastTraffic().leaves_added, staged.lastTraffic().leaves_added);
    ASSERT_EQ(in_place.lastTraffic().leaves_patched, staged.lastTraffic().leaves_patched);
    ASSERT_EQ(in_place.usedBytes(), staged.usedBytes());
    ASSERT_EQ(std::memcmp(in_place.grid(), staged.grid(), in_place.usedBytes()), 0);
  }
}

/// A device that fails in the middle of a frame leaves a grid with unknown contents.
TEST(MirrorContract, AfterAWriteThatFailedNothingIsTakenAnyMore) {
  auto owned = std::make_unique<StagedArena>();
  StagedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  ChangeMaker maker(12);
  mirror.apply(maker.batch(50));
  arena.before_send = [] { throw DeviceError("device.failed", "cuda", "lost", "Check the GPU"); };
  EXPECT_THROW(mirror.apply(maker.batch(50)), DeviceError);
  arena.before_send = nullptr;
  try {
    mirror.apply(maker.batch(50));
    FAIL() << "went on after half a frame";
  } catch (const InternalError& error) {
    EXPECT_EQ(error.id(), "mirror.half_written");
  }
}

/// Memory that runs out at any point of a frame: nothing was written, and the same frame succeeds once there is memory.
TEST(MirrorContract, WithoutMemoryNothingIsWritten) {
  int refused = 0;
  for (int fail_at = 0; fail_at < 12; ++fail_at) {
    SCOPED_TRACE(fail_at);
    auto owned = std::make_unique<StagedArena>(std::uint64_t(600) << 20);
    StagedArena& arena = *owned;
    NanoVdbMirror mirror(std::move(owned), 0.01), expected(std::make_unique<HostArena>(), 0.01);
    ChangeMaker maker(13);
    const auto first = maker.batch(100);
    mirror.apply(first);
    expected.apply(first);
    const TreeCensus before = walkTree(*mirror.grid());
    const std::uint64_t sent = arena.sent_bytes;
    std::vector<LeafChange> far;  // one root tile and one lower node each: the arena has to grow repeatedly
    for (int n = 0; n < 1500; ++n) far.push_back(maker.change({4096 * (n % 300) + 128 * n, 4096 * 3, 8}));
    int commits = 0;
    arena.before_commit = [&] {
      if (commits++ == fail_at) throw ResourceLimit("memory.device", "cuda", "none left", "Free some");
    };
    try {
      mirror.apply(far);
    } catch (const ResourceLimit&) {
      ++refused;
      ASSERT_EQ(arena.sent_bytes, sent);
      ASSERT_EQ(walkTree(*mirror.grid()).true_voxels, before.true_voxels);
      ASSERT_EQ(walkTree(*mirror.grid()).leaves, before.leaves);
      mirror.apply(far);
    }
    expected.apply(far);
    const TreeCensus found = walkTree(*mirror.grid()), wanted = walkTree(*expected.grid());
    ASSERT_EQ(found.problem, "");
    ASSERT_EQ(found.leaves, wanted.leaves);
    ASSERT_EQ(found.true_voxels, wanted.true_voxels);
    ASSERT_EQ(found.active_voxels, wanted.active_voxels);
  }
  EXPECT_GT(refused, 1);
}

TEST(MirrorContract, RefusesWhatMakesNoSense) {
  const auto make = [](double voxel_size_m, std::uint32_t tiles) {
    NanoVdbMirror mirror(std::make_unique<HostArena>(), voxel_size_m, tiles);
  };
  EXPECT_THROW(make(std::numeric_limits<double>::quiet_NaN(), 16), InvalidArgument);
  EXPECT_THROW(make(std::numeric_limits<double>::infinity(), 16), InvalidArgument);
  EXPECT_THROW(make(0.0, 16), InvalidArgument);
  EXPECT_THROW(make(0.01, 0), InvalidArgument);
  EXPECT_THROW(make(0.01, NanoVdbMirror::kMaxRootCapacity + 1), InvalidArgument);
  NanoVdbMirror mirror(std::make_unique<HostArena>(), 0.01);
  LeafChange change;
  change.origin_ijk = {0, 4, 0};
  change.collides_on[0] = 1;
  EXPECT_THROW(mirror.apply({&change, 1}), InternalError);
  EXPECT_EQ(walkTree(*mirror.grid()).true_voxels, 0u);
}

TEST(HostArena, GrowsInPlaceAndKeepsWhatWasWritten) {
  HostArena arena(std::uint64_t(300) << 20);
  EXPECT_EQ(arena.reservedBytes(), std::uint64_t(300) << 20);
  EXPECT_EQ(arena.committedBytes(), 0u);
  void* const base = arena.base();
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(base) % 4096, 0u);
  const std::uint64_t mark = 0x0123456789ABCDEF;
  arena.commit(100);
  arena.write(92, &mark, 8);
  for (std::uint64_t mib = 1; mib <= 300; mib += 23) {
    arena.commit(mib << 20);
    ASSERT_GE(arena.committedBytes(), mib << 20);
    ASSERT_LE(arena.committedBytes(), arena.reservedBytes());
    ASSERT_EQ(arena.base(), base);
    ASSERT_EQ(static_cast<const unsigned char*>(base)[(mib << 20) - 1], 0);
  }
  std::uint64_t read = 0;
  std::memcpy(&read, static_cast<const unsigned char*>(base) + 92, 8);
  EXPECT_EQ(read, mark);
}

TEST(HostArena, StopsAtItsLimits) {
  HostArena arena(std::uint64_t(4) << 20);
  arena.commit(std::uint64_t(4) << 20);
  EXPECT_EQ(arena.committedBytes(), std::uint64_t(4) << 20);
  try {
    arena.commit((std::uint64_t(4) << 20) + 1);
    FAIL() << "committed more than was reserved";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "memory.mirror_reserve");
    EXPECT_EQ(error.exitCode(), 5);
  }
  const char byte = 1;
  EXPECT_NO_THROW(arena.write(arena.committedBytes() - 1, &byte, 1));
  EXPECT_THROW(arena.write(arena.committedBytes(), &byte, 1), InternalError);
  EXPECT_THROW(arena.write(~std::uint64_t(0), &byte, 1), InternalError);
  EXPECT_THROW(HostArena(0), InvalidArgument);
}

}  // namespace
}  // namespace accessvdb::testing
