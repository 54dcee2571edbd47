// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The mirror of distances in device memory: against an OpenVDB grid changed voxel by voxel, read back in a kernel by
// NanoVDB's own accessor; against the bytes of the host's mirror; and against the map of a live field.
#include <gtest/gtest.h>
#include <cstring>

#include "accessvdb/device_view.h"
#include "accessvdb/tsdf_volume.h"
#include "cpu/host_arena.h"
#include "cuda/cuda_backend.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/device_reads.h"
#include "parity/distance_checks.h"
#include "parity/gpu_test.h"
#include "support/query_world.h"
#include "vdb/standard_grids.h"

namespace accessvdb::test {
namespace {

using accessvdb::testing::DistanceWorld;
using internal::DistanceMirror;

std::unique_ptr<DistanceMirror> mirrorIn(std::unique_ptr<kernels::MirrorArena> arena) {
  return std::make_unique<DistanceMirror>(std::move(arena), 0.01, DistanceMirror::kDefaultRootCapacity,
                                          DistanceWorld::leaves());
}

class CudaDistance : public GpuTest {
 protected:
  void SetUp() override {
    GpuTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    openvdb::initialize();
    backend_ = kernels::makeCudaBackend(kernels::CudaOptions{});
  }

  void expectEqual(DistanceWorld& world, const DistanceMirror& mirror) {
    std::vector<nanovdb::Coord> voxels;
    std::vector<DistanceRead> expected;
    world.forEachVoxel([&](const openvdb::Coord& ijk, float value, bool active) {
      voxels.emplace_back(ijk.x(), ijk.y(), ijk.z());
      expected.push_back({value, active});
    });
    backend_->waitForMirror();  // the only thing that orders readers after the mirror's stream
    const std::vector<DistanceRead> found = readDistancesOnDevice(*backend_, mirror.grid(), voxels);
    std::size_t active = 0;
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      ASSERT_EQ(found[n].value, expected[n].value) << voxels[n][0] << " " << voxels[n][1] << " " << voxels[n][2];
      ASSERT_EQ(found[n].active, expected[n].active) << voxels[n][0] << " " << voxels[n][1] << " " << voxels[n][2];
      active += found[n].active ? 1 : 0;
    }
    ASSERT_GT(active, 1000u);
  }

  std::unique_ptr<kernels::CudaBackend> backend_;
};

/// All octants, both sides of root tiles, new nodes of every level whose entries are background.
TEST_F(CudaDistance, EqualsOpenVdbAfterRoundsOfRandomChanges) {
  DistanceWorld world(31);
  const auto mirror = mirrorIn(backend_->makeArena());
  for (int round = 0; round < 12; ++round) {
    SCOPED_TRACE(round);
    mirror->apply(world.batch(250));
    if (round % 3 == 2) expectEqual(world, *mirror);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(mirror->rootTileCount(), 100u);
}

/// More than one batch of staging, and growth of the range, in one call.
TEST_F(CudaDistance, TakesAFrameOfManyLeaves) {
  DistanceWorld world(32);
  const auto mirror = mirrorIn(backend_->makeArena());
  std::vector<DistanceChange> changes;
  for (int x = -22; x < 22; ++x) {
    for (int y = -22; y < 22; ++y) {
      for (int z = -8; z < 8; ++z) changes.push_back(world.change({8 * x, 8 * y, 8 * z}));
    }
  }
  mirror->apply(changes);
  EXPECT_GT(mirror->lastTraffic().bytes_written, std::uint64_t(24) << 20);
  expectEqual(world, *mirror);
}

/// Every byte of the grid, after frames of new and known leaves and joined scans.
TEST_F(CudaDistance, HoldsTheSameBytesAsTheHosts) {
  DistanceWorld world(33);
  const auto cuda = mirrorIn(backend_->makeArena()), host = mirrorIn(std::make_unique<kernels::HostArena>());
  for (int round = 0; round < 4; ++round) {
    std::vector<DistanceChange> changes;
    for (int x = -14; x < 14; ++x) {
      for (int y = -14; y < 14; ++y) {
        for (int z = -8; z < 8; ++z) {
          if (world.maker().below(2) == 0) changes.push_back(world.change({8 * x + 2048 * (round % 2), 8 * y, 8 * z}));
        }
      }
    }
    if (round == 3) {
      const auto again = world.batch(300);
      changes.insert(changes.end(), again.begin(), again.end());
    }
    cuda->apply(changes);
    host->apply(changes);
    ASSERT_EQ(cuda->usedBytes(), host->usedBytes());
    backend_->waitForMirror();
    std::vector<std::byte> found(cuda->usedBytes());
    backend_->download(found.data(), cuda->grid(), found.size());
    // The only field that depends on the arena.
    reinterpret_cast<kernels::DistanceGrid::DataType*>(found.data())->mGridSize = host->grid()->gridSize();
    ASSERT_EQ(std::memcmp(found.data(), host->grid(), found.size()), 0) << round;
  }
}

/// Two mirrors of one backend share its stream and its event: waiting for the event makes both visible, whichever was
/// flushed last.
TEST_F(CudaDistance, StandsBesideTheMirrorOfScoring) {
  DistanceWorld world(34);
  accessvdb::testing::ChangeMaker maker(35);
  const auto distances = mirrorIn(backend_->makeArena());
  internal::NanoVdbMirror facts(backend_->makeArena(), 0.01), host(std::make_unique<kernels::HostArena>(), 0.01);
  for (int round = 0; round < 6; ++round) {
    SCOPED_TRACE(round);
    const auto changes = maker.batch(600);
    const auto rows = world.batch(200);
    host.apply(changes);
    if (round % 2 == 0) {
      facts.apply(changes);
      distances->apply(rows);
    } else {
      distances->apply(rows);
      facts.apply(changes);
    }
    expectEqual(world, *distances);
    if (HasFatalFailure()) return;
    std::vector<std::byte> found(facts.usedBytes());
    backend_->download(found.data(), facts.grid(), found.size());
    reinterpret_cast<kernels::OccupancyGrid::DataType*>(found.data())->mGridSize = host.grid()->gridSize();
    ASSERT_EQ(std::memcmp(found.data(), host.grid(), found.size()), 0);
  }
}

/// Fills come before what is written over them, in pieces, and touch nothing else.
TEST_F(CudaDistance, ArenaFillsPieces) {
  const auto arena = backend_->makeArena();
  arena->commit(1 << 20);
  std::vector<std::uint32_t> expected((1 << 20) / 4, 0);
  std::mt19937_64 random(6);
  for (int round = 0; round < 10; ++round) {
    std::vector<kernels::ArenaFill> fills;
    std::uint32_t at = static_cast<std::uint32_t>(random() % 64);  // words
    for (int n = 0; n < 60; ++n) {
      kernels::ArenaFill fill;
      const auto words = static_cast<std::uint32_t>(1 + random() % 300);
      const auto stride = static_cast<std::uint32_t>(words + random() % 50);
      fill.count = static_cast<std::uint32_t>(1 + random() % 8);
      fill.bytes = 4 * words;
      fill.stride = 4 * stride;
      fill.offset = 4 * std::uint64_t{at};
      fill.word = static_cast<std::uint32_t>(random());
      for (std::uint32_t piece = 0; piece < fill.count; ++piece) {
        std::fill_n(expected.begin() + at + piece * stride, words, fill.word);
      }
      fills.push_back(fill);
      at += fill.count * stride + static_cast<std::uint32_t>(random() % 20);
    }
    ASSERT_LT(at, expected.size());
    const std::uint32_t early = 1;
    arena->write(4 * (expected.size() - 1), &early, 4);  // begins a list of single writes
    expected.back() = early;
    arena->stageFills(fills);
    for (std::uint32_t n = 0; n < 40; ++n) {
      const std::uint32_t place = n * 97, late = n;
      arena->write(4 * std::uint64_t{place}, &late, 4);
      expected[place] = late;
    }
    arena->flush();
  }
  backend_->waitForMirror();
  std::vector<std::uint32_t> found(expected.size());
  backend_->download(found.data(), arena->base(), 4 * found.size());
  EXPECT_EQ(found, expected);
}

/// Without memory, nothing new becomes readable, and everything old stays.
TEST_F(CudaDistance, AMirrorThatCannotGrowStaysReadable) {
  kernels::CudaOptions options;
  options.memory_limit_bytes = std::uint64_t(160) << 20;
  backend_ = kernels::makeCudaBackend(options);
  DistanceWorld world(36), far(37);
  const auto mirror = mirrorIn(backend_->makeArena());
  std::vector<DistanceChange> changes;
  for (int n = 0; n < 300; ++n) changes.push_back(world.change({8 * (n % 30) - 96, 8 * (n / 30) - 32, -8}));
  mirror->apply(changes);
  bool refused = false;
  for (int round = 0; round < 200 && !refused; ++round) {
    std::vector<DistanceChange> more = far.batch(200);
    for (DistanceChange& change : more) change.origin_ijk[0] += 1 << 16;
    const std::uint64_t leaves = mirror->leafCount();
    try {
      mirror->apply(more);
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "memory.device");
      EXPECT_EQ(mirror->leafCount(), leaves);
      refused = true;
    }
  }
  EXPECT_TRUE(refused);
  std::vector<nanovdb::Coord> voxels;
  std::vector<DistanceRead> expected;
  for (auto leaf = world.grid().tree().cbeginLeaf(); leaf; ++leaf) {
    for (auto voxel = leaf->cbeginValueAll(); voxel; ++voxel) {
      voxels.emplace_back(voxel.getCoord().x(), voxel.getCoord().y(), voxel.getCoord().z());
      expected.push_back({*voxel, voxel.isValueOn()});
    }
  }
  backend_->waitForMirror();
  // That backend has no memory left for reading.
  const auto other = kernels::makeCudaBackend(kernels::CudaOptions{});
  const auto found = readDistancesOnDevice(*other, mirror->grid(), voxels);
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    ASSERT_EQ(found[n].value, expected[n].value);
    ASSERT_EQ(found[n].active, expected[n].active);
  }
}

TEST_F(CudaDistance, NothingIsAllocatedOnceWarm) {
  DistanceWorld world(38);
  const auto mirror = mirrorIn(backend_->makeArena());
  std::vector<DistanceChange> changes;
  for (int n = 0; n < 2000; ++n) changes.push_back(world.change({8 * (n % 50), 8 * (n / 50), -8}));
  for (int n = 0; n < 2; ++n) mirror->apply(changes);
  backend_->finish();
  const std::uint64_t allocations = backend_->allocations(), bytes = backend_->heldBytes();
  for (int n = 0; n < 10; ++n) mirror->apply(changes);
  backend_->finish();
  EXPECT_EQ(backend_->allocations(), allocations);
  EXPECT_EQ(backend_->heldBytes(), bytes);
}

/// On a walk of the sensor, the device's grid equals the map's after every scan, voxel for voxel.
TEST_F(CudaDistance, EqualsTheMapOfALiveField) {
  QueryWorld cuda(0, BackendKind::Cuda, 0, true);
  for (int n = 0; n < 2; ++n) {
    SCOPED_TRACE(n);
    if (n == 1) cuda.integrate(5);
    const DeviceView view = cuda.field.deviceView();
    ASSERT_TRUE(view.distance_available);
    const openvdb::FloatGrid::Ptr map = cuda.field.volume().distance();
    const auto reads = map->getConstAccessor();
    std::vector<nanovdb::Coord> voxels;
    std::vector<DistanceRead> expected;
    for (auto leaf = map->tree().cbeginLeaf(); leaf; ++leaf) {
      openvdb::CoordBBox box = leaf->getNodeBoundingBox();
      box.expand(1);
      for (auto ijk = box.begin(); ijk; ++ijk) {
        voxels.emplace_back((*ijk).x(), (*ijk).y(), (*ijk).z());
        expected.push_back({reads.getValue(*ijk), reads.isValueOn(*ijk)});
      }
    }
    const auto found = readDistancesOnDevice(*backend_, view.distance.grid, voxels);
    std::size_t differ = 0, active = 0;
    for (std::size_t v = 0; v < voxels.size(); ++v) {
      differ += found[v].value != expected[v].value || found[v].active != expected[v].active;
      active += found[v].active;
    }
    EXPECT_EQ(differ, 0u);
    EXPECT_GT(active, 10000u);
  }
}

}  // namespace
}  // namespace accessvdb::test
