// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Device memory: what is counted, what happens when there is none, and that nothing is allocated once warm.
#include <gtest/gtest.h>

#include "accessvdb/accessibility_field.h"
#include "parity/gpu_test.h"
#include "parity/mirror_checks.h"
#include "parity/scoring_rig.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

using accessvdb::testing::ChangeMaker;

class CudaMemory : public GpuTest {};

ScoringCase someCase(int points) {
  Random random(3);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  return randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, points);
}

std::unique_ptr<kernels::CudaBackend> limited(std::uint64_t bytes) {
  kernels::CudaOptions options;
  options.memory_limit_bytes = bytes;
  return kernels::makeCudaBackend(options);
}

TEST_F(CudaMemory, IsCountedAndGivenBack) {
  const auto backend = limited(1 << 20);
  void* a = backend->allocate(600000);
  EXPECT_EQ(backend->heldBytes(), 600000u);
  try {
    backend->allocate(600000);
    FAIL() << "over the limit";
  } catch (const ResourceLimit& error) {
    EXPECT_EQ(error.id(), "memory.device");
    EXPECT_EQ(error.exitCode(), 5);
  }
  backend->release(a, 600000);
  EXPECT_EQ(backend->heldBytes(), 0u);
  backend->release(backend->allocate(600000), 600000);
  EXPECT_EQ(backend->peakBytes(), 600000u);
}

TEST_F(CudaMemory, MoreThanTheCardHasIsRefusedAndHarmless) {
  const auto backend = kernels::makeCudaBackend(kernels::CudaOptions{});
  EXPECT_THROW(backend->allocate(std::size_t(1) << 44), ResourceLimit);
  EXPECT_EQ(backend->heldBytes(), 0u);
  backend->release(backend->allocate(1000), 1000);
}

/// The first run shows the memory needed; with less, chunks shrink and the results stay the same, until nothing fits.
TEST_F(CudaMemory, ScoresInSmallerChunksWhenThereIsLess) {
  const ScoringCase what = someCase(6000);
  ScoringRig cpu(kernels::makeCpuBackend(), what);
  const auto expected = cpu.score(what.items, false);
  std::uint64_t before = 0, all = 0;
  {
    auto backend = kernels::makeCudaBackend(kernels::CudaOptions{});
    const kernels::CudaBackend& held = *backend;
    ScoringRig cuda(std::move(backend), what);
    before = held.heldBytes();
    expectSameResults(cuda.score(what.items, false), expected);
    all = held.peakBytes();
  }
  ASSERT_GT(all, before + 500000);
  int smaller = 0, refused = 0;
  for (std::uint64_t limit = all - 1; limit > before && refused == 0; limit = before + (limit - before) / 2) {
    SCOPED_TRACE(limit);
    ScoringRig cuda(limited(limit), what);
    try {
      expectSameResults(cuda.score(what.items, false), expected);
      ++smaller;
    } catch (const ResourceLimit& error) {
      EXPECT_EQ(error.id(), "memory.device");
      ++refused;
    }
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(smaller, 1);
  EXPECT_EQ(refused, 1);
}

TEST_F(CudaMemory, AMirrorThatCannotGrowStaysReadable) {
  ScoringCase what = someCase(500);
  ScoringRig cpu(kernels::makeCpuBackend(), what);
  auto backend = limited(std::uint64_t(48) << 20);
  ScoringRig cuda(std::move(backend), what);
  expectSameResults(cuda.score(what.items, false), cpu.score(what.items, false));  // its own memory is allocated by now
  const auto expected = cpu.score(what.items, false);
  ChangeMaker maker(4);
  bool refused = false;
  for (int round = 0; round < 200 && !refused; ++round) {
    std::vector<LeafChange> far = maker.batch(400);
    for (LeafChange& change : far) change.origin_ijk[0] += 1 << 16;
    try {
      cuda.mirror().apply(far);
    } catch (const ResourceLimit&) {
      refused = true;
    }
  }
  EXPECT_TRUE(refused);
  expectSameResults(cuda.score(what.items, false), expected);
}

TEST_F(CudaMemory, NothingIsAllocatedOnceWarm) {
  const ScoringCase what = someCase(3000);
  auto owned = kernels::makeCudaBackend(kernels::CudaOptions{});
  const kernels::CudaBackend& backend = *owned;
  ScoringRig cuda(std::move(owned), what);
  const auto frame = [&](std::size_t items) {
    cuda.mirror().apply(what.changes.front());
    (void)cuda.score(std::span(what.items).first(items), false);
  };
  ASSERT_GT(what.items.size(), 2000u);
  for (int n = 0; n < 3; ++n) frame(what.items.size());
  const std::uint64_t allocations = backend.allocations(), held = backend.heldBytes();
  for (const std::size_t items : {std::size_t{2000}, std::size_t{100}, what.items.size(), std::size_t{1}}) frame(items);
  EXPECT_EQ(backend.allocations(), allocations);
  EXPECT_EQ(backend.heldBytes(), held);
}

/// A whole field on a card filled by others: a clear error, and no answers from a half-updated field.
TEST_F(CudaMemory, AFieldThatRunsOutAnswersNoMore) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.02;
  params.backend = BackendKind::Cuda;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  WalkOptions options;
  options.frames = 30;
  options.rays_per_frame = 20000;
  options.max_range_m = 12;
  const WalkGenerator walk(options);
  const auto hog = kernels::makeCudaBackend(kernels::CudaOptions{});
  std::vector<std::pair<void*, std::size_t>> taken;
  for (std::size_t bytes = std::size_t(64) << 30; bytes >= 1 << 20;) {
    try {
      taken.emplace_back(hog->allocate(bytes), bytes);
    } catch (const ResourceLimit&) {
      bytes /= 2;
    }
  }
  bool refused = false;
  for (int n = 0; n < options.frames && !refused; ++n) {
    try {
      const WalkFrame scan = walk.frame(n);
      field.integrateScan(scan.points_S, scan.T_W_S);
      field.update();
    } catch (const ResourceLimit& error) {
      refused = true;
      EXPECT_EQ(error.exitCode(), 5);
    }
  }
  ASSERT_TRUE(refused);
  EXPECT_THROW((void)field.snapshot(), ResourceLimit);
  EXPECT_THROW(field.update(), ResourceLimit);
  for (const auto& [address, bytes] : taken) hog->release(address, bytes);
  EXPECT_THROW((void)field.snapshot(), ResourceLimit);
  AccessibilityField anew(ToolGeometry::builtin("builtin:pruner"), params);  // the device itself still works
  const WalkFrame scan = walk.frame(0);
  anew.integrateScan(scan.points_S, scan.T_W_S);
  anew.update();
  EXPECT_GT(anew.snapshot().points.size(), 1000u);
  EXPECT_GT(anew.memoryUse().device_peak_bytes, std::uint64_t(1) << 20);
}

}  // namespace
}  // namespace accessvdb::test
