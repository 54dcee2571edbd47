// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The mirror in device memory against an OpenVDB grid changed voxel by voxel: read back in a kernel by NanoVDB's own
// accessor, in all octants and on both sides of root tiles.
#include <gtest/gtest.h>
#include <cstring>

#include "cpu/host_arena.h"
#include "cuda/cuda_backend.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/device_reads.h"
#include "parity/gpu_test.h"
#include "parity/mirror_checks.h"
#include "vdb/standard_grids.h"

namespace accessvdb::test {
namespace {

using accessvdb::testing::ChangeMaker;
using internal::NanoVdbMirror;

class CudaMirror : public GpuTest {
 protected:
  void SetUp() override {
    GpuTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    openvdb::initialize();
    backend_ = kernels::makeCudaBackend(kernels::CudaOptions{});
  }

  /// Applies the changes to an OpenVDB grid, one voxel at a time.
  void applyToOracle(const std::vector<LeafChange>& changes) {
    auto voxels = oracle_->getAccessor();
    const auto forBits = [](const LeafChange& change, const LeafBits& bits, const auto& act) {
      for (int n = 0; n < 512; ++n) {
        if ((bits[static_cast<std::size_t>(n / 64)] >> (n % 64) & 1) == 0) continue;
        act(openvdb::Coord(change.origin_ijk[0] + (n >> 6), change.origin_ijk[1] + (n >> 3 & 7),
                           change.origin_ijk[2] + (n & 7)));
      }
    };
    for (const LeafChange& change : changes) {
      forBits(change, change.collides_on, [&](const auto& ijk) { voxels.setValueOnly(ijk, true); });
      forBits(change, change.collides_off, [&](const auto& ijk) { voxels.setValueOnly(ijk, false); });
      forBits(change, change.arm_free_on, [&](const auto& ijk) { voxels.setActiveState(ijk, true); });
      forBits(change, change.arm_free_off, [&](const auto& ijk) { voxels.setActiveState(ijk, false); });
    }
  }

  /// Every voxel of every leaf of the oracle, then random ones, most of them background.
  void expectEqual(const NanoVdbMirror& mirror, ChangeMaker& maker) {
    std::vector<nanovdb::Coord> voxels;
    std::vector<std::uint8_t> expected;
    auto reads = oracle_->getConstAccessor();
    const auto add = [&](const openvdb::Coord& ijk) {
      voxels.emplace_back(ijk.x(), ijk.y(), ijk.z());
      expected.push_back(static_cast<std::uint8_t>((reads.getValue(ijk) ? 1 : 0) | (reads.isValueOn(ijk) ? 2 : 0)));
    };
    for (auto leaf = oracle_->tree().cbeginLeaf(); leaf; ++leaf) {
      for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) add(voxel.getCoord());
    }
    for (int n = 0; n < 20000; ++n) {
      const auto origin = maker.origin();
      const auto near = [&](int c) { return c + static_cast<int>(maker.below(300)) - 150; };
      add(openvdb::Coord(near(origin[0]), near(origin[1]), near(origin[2])));
    }
    backend_->finish();
    const std::vector<std::uint8_t> found = readOnDevice(*backend_, mirror.grid(), voxels);
    std::size_t ones = 0;
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      ASSERT_EQ(found[n], expected[n]) << voxels[n][0] << " " << voxels[n][1] << " " << voxels[n][2];
      ones += found[n] != 0 ? 1 : 0;
    }
    ASSERT_GT(ones, 1000u);
  }

  std::unique_ptr<kernels::CudaBackend> backend_;
  openvdb::BoolGrid::Ptr oracle_ = openvdb::BoolGrid::create(false);
};

TEST_F(CudaMirror, EqualsOpenVdbAfterRoundsOfRandomChanges) {
  ChangeMaker maker(21);
  NanoVdbMirror mirror(backend_->makeArena(), 0.01);
  for (int round = 0; round < 15; ++round) {
    SCOPED_TRACE(round);
    const std::vector<LeafChange> changes = maker.batch(400);
    mirror.apply(changes);
    applyToOracle(changes);
    if (round % 3 == 2) expectEqual(mirror, maker);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(mirror.rootTileCount(), 100u);
}

/// More than one batch of staging, and growth of the range, in one call.
TEST_F(CudaMirror, TakesAFrameOfManyLeaves) {
  NanoVdbMirror mirror(backend_->makeArena(), 0.01);
  ChangeMaker maker(22);
  std::vector<LeafChange> changes;
  for (int x = -45; x < 45; ++x) {
    for (int y = -45; y < 45; ++y) {
      for (int z = -15; z < 15; ++z) changes.push_back(maker.change({8 * x, 8 * y, 8 * z}));
    }
  }
  mirror.apply(changes);
  applyToOracle(changes);
  EXPECT_GT(mirror.lastTraffic().bytes_written, std::uint64_t(32) << 20);
  expectEqual(mirror, maker);
}

/// Every byte of the grid, cell counts and links included, after frames of new and known leaves and joined scans.
TEST_F(CudaMirror, HoldsTheSameBytesAsTheHosts) {
  NanoVdbMirror cuda(backend_->makeArena(), 0.01), host(std::make_unique<kernels::HostArena>(), 0.01);
  ChangeMaker maker(23);
  for (int round = 0; round < 4; ++round) {
    std::vector<LeafChange> changes;
    for (int x = -24; x < 24; ++x) {
      for (int y = -24; y < 24; ++y) {
        for (int z = -12; z < 12; ++z) {
          if (maker.below(2) == 0) changes.push_back(maker.change({8 * x + 2048 * (round % 2), 8 * y, 8 * z}));
        }
      }
    }
    if (round == 3) {
      const auto again = maker.batch(500);
      changes.insert(changes.end(), again.begin(), again.end());
    }
    cuda.apply(changes);
    host.apply(changes);
    ASSERT_EQ(cuda.usedBytes(), host.usedBytes());
    backend_->finish();
    std::vector<std::byte> found(cuda.usedBytes());
    backend_->download(found.data(), cuda.grid(), found.size());
    // The only field that depends on the arena.
    reinterpret_cast<kernels::OccupancyGrid::DataType*>(found.data())->mGridSize = host.grid()->gridSize();
    ASSERT_EQ(std::memcmp(found.data(), host.grid(), found.size()), 0) << round;
  }
}

/// Writes of any length and alignment, in order of the calls.
TEST_F(CudaMirror, ArenaTakesAnyBytes) {
  const auto arena = backend_->makeArena();
  arena->commit(1 << 20);
  std::vector<std::uint8_t> expected(1 << 20, 0);
  std::mt19937_64 random(5);
  for (int round = 0; round < 20; ++round) {
    std::uint64_t at = random() % 64;
    for (int n = 0; n < 300; ++n) {
      std::vector<std::uint8_t> bytes(random() % 200);
      for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
      arena->write(at, bytes.data(), bytes.size());
      std::copy(bytes.begin(), bytes.end(), expected.begin() + static_cast<std::ptrdiff_t>(at));
      at += bytes.size() + random() % 40;
    }
    arena->flush();
  }
  backend_->finish();
  std::vector<std::uint8_t> found(1 << 20);
  backend_->download(found.data(), arena->base(), found.size());
  EXPECT_EQ(found, expected);
  EXPECT_THROW(arena->write(arena->committedBytes() - 3, found.data(), 4), InternalError);
}

}  // namespace
}  // namespace accessvdb::test
