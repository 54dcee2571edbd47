// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// What the mirror promises to an arena (order of writes, no byte twice), and what the host arena promises to it.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <map>

#include "accessvdb/error.h"
#include "cpu/host_arena.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/mirror_checks.h"

namespace accessvdb::testing {
namespace {

using internal::NanoVdbMirror;
using kernels::HostArena;

/// A host arena that looks at every write.
class WatchedArena final : public kernels::MirrorArena {
 public:
  [[nodiscard]] void* base() const noexcept override { return memory_.base(); }
  void commit(std::uint64_t bytes) override { memory_.commit(bytes); }
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override {
    memory_.write(offset, source, bytes);
    const auto next = written_.lower_bound(offset);
    if (next != written_.end() && next->first < offset + bytes) ++overlaps_;
    if (next != written_.begin() && std::prev(next)->second > offset) ++overlaps_;
    written_[offset] = offset + bytes;
    if (after_write_) after_write_();
  }
  void flush() override { written_.clear(); }
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return memory_.reservedBytes(); }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return memory_.committedBytes(); }

  std::function<void()> after_write_;
  int overlaps_ = 0;

 private:
  HostArena memory_;
  std::map<std::uint64_t, std::uint64_t> written_;  // begin to end, since the last flush
};

TEST(MirrorContract, TheGridIsSoundAfterEverySingleWrite) {
  auto owned = std::make_unique<WatchedArena>();
  WatchedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  int writes = 0;
  arena.after_write_ = [&] {
    ++writes;
    ASSERT_EQ(walkTree(*mirror.grid()).problem, "");
  };
  ChangeMaker maker(8);
  for (int round = 0; round < 6 && !HasFatalFailure(); ++round) mirror.apply(maker.batch(25));
  EXPECT_GT(writes, 300);
}

TEST(MirrorContract, NoByteIsWrittenTwiceBetweenFlushes) {
  auto owned = std::make_unique<WatchedArena>();
  WatchedArena& arena = *owned;
  NanoVdbMirror mirror(std::move(owned), 0.01);
  ChangeMaker maker(9);
  for (int round = 0; round < 10; ++round) {
    auto changes = maker.batch(400);
    const auto again = changes;
    changes.insert(changes.end(), again.begin(), again.end());  // leaves that come twice
    mirror.apply(changes);
    ASSERT_EQ(arena.overlaps_, 0);
  }
  mirror.clear();
  EXPECT_EQ(arena.overlaps_, 0);
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
  EXPECT_EQ(mirror.lastTraffic().bytes_written, 128u);
}

TEST(MirrorContract, ReuseOfTheSameLeavesTakesNoMoreMemory) {
  NanoVdbMirror mirror(std::make_unique<HostArena>(), 0.01);
  ChangeMaker maker(10);
  const auto changes = maker.batch(100);
  mirror.apply(changes);
  mirror.clear();
  mirror.apply(changes);
  const std::uint64_t used_bytes = mirror.usedBytes(), host_bytes = mirror.hostBytes();
  for (int round = 0; round < 50; ++round) {
    mirror.clear();
    mirror.apply(changes);
  }
  EXPECT_EQ(mirror.usedBytes(), used_bytes);
  EXPECT_EQ(mirror.hostBytes(), host_bytes);
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
