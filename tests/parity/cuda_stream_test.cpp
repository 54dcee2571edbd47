// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// A field on the GPU against a field on the CPU, on streams: after every update all points are the same, bit for bit.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <set>
#include <utility>

#include "hostdev/direction_filter.h"
#include "hostdev/known_levels.h"
#include "hostdev/known_slots.h"
#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "support/determinism_support.h"
#include "support/same_map.h"
#include "tool/tool_kernel.h"
#include "tool/tool_slabs.h"
#include "update/block_groups.h"

namespace accessvdb::test {
namespace {

struct StreamCase {
  std::uint64_t seed;
  const char* tool;
  double voxel_size_m;
  UpdatePolicy policy = UpdatePolicy::Exact;
  ToolForm form = ToolForm::Voxels;
  int max_collisions = 0;
  int budget_points = 0;  ///< only with the paper's policy, with which the same points wait on both
  int scans_an_update = 1;
  int neighbours = 0;
  int directions = 180;
  int frames = 14;
  int rays_per_frame = 4000;
  double range_noise_m = 0.02;
  double max_range_m = 8;
  double length_m = 4;
  const char* orientations = "yaw";
  int rolls = 0;
};
void PrintTo(const StreamCase& c, std::ostream* out) {
  *out << c.tool << " at " << c.voxel_size_m << " m, " << (c.policy == UpdatePolicy::Exact ? "exact" : "paper") << ", "
       << (c.form == ToolForm::Voxels ? "voxels" : "samples") << (c.budget_points > 0 ? ", with a budget" : "")
       << (c.scans_an_update > 1 ? ", several scans an update" : "") << (c.neighbours > 0 ? ", many neighbours" : "")
       << ", " << c.orientations << ", rolls " << c.rolls;
}

WalkGenerator walkOf(const StreamCase& c) {
  WalkOptions options = parityWalk(c.seed, c.frames, c.rays_per_frame);
  options.range_noise_m = c.range_noise_m;
  options.max_range_m = c.max_range_m;
  options.length_m = c.length_m;
  return WalkGenerator(options);
}

FieldParams paramsOf(const StreamCase& c) {
  FieldParams params;
  params.tsdf.voxel_size_m = c.voxel_size_m;
  params.tsdf.range_noise_m = c.range_noise_m;
  params.scoring.form = c.form;
  params.scoring.surface_samples = 200;
  params.scoring.max_collisions = c.max_collisions;
  params.update.policy = c.policy;
  params.update.budget_points = c.budget_points;
  params.scoring.neighbours = c.neighbours;
  params.approach.num_directions = c.directions;
  params.approach.orientations = OrientationSet::parse(c.orientations);
  params.approach.rolls = c.rolls;
  return params;
}

/// Short enough for the sanitizers, which racecheck makes about a hundred times slower; coarse, but with cells.
constexpr StreamCase kShortStream = {
    .seed = 9, .tool = "builtin:pruner", .voxel_size_m = 0.06, .directions = 36, .frames = 4, .rays_per_frame = 1500};

/// A tool that takes many leaves as a whole, and a limit that some directions stay within.
constexpr StreamCase kThickTool = {.seed = 12,
                                   .tool = "builtin:pruner",
                                   .voxel_size_m = 0.01,
                                   .directions = 36,
                                   .frames = 8,
                                   .rays_per_frame = 20000,
                                   .max_range_m = 3,
                                   .length_m = 0.5};

/// A short version for the sanitizers.
constexpr StreamCase kShortThickTool = {.seed = 12,
                                        .tool = "builtin:pruner",
                                        .voxel_size_m = 0.01,
                                        .directions = 12,
                                        .frames = 4,
                                        .rays_per_frame = 8000,
                                        .max_range_m = 2.5,
                                        .length_m = 0.1};

/// A short one of the sphere, for the sanitizers.
constexpr StreamCase kShortSphere = {.seed = 26,
                                     .tool = "builtin:pruner",
                                     .voxel_size_m = 0.06,
                                     .frames = 4,
                                     .rays_per_frame = 1500,
                                     .orientations = "sphere:30"};

/// A short wide set, for the sanitizers.
constexpr StreamCase kShortWide = {.seed = 33,
                                   .tool = "builtin:pruner",
                                   .voxel_size_m = 0.06,
                                   .max_collisions = 1,
                                   .frames = 4,
                                   .rays_per_frame = 1500,
                                   .orientations = "pitch:-10:10:10"};

/// So few returns at a time, of places that were seen before, that most neighbourhoods near them follow what moved and
/// are not searched again; seldom updated, what was prepared for one scan is forgotten with the next.
constexpr StreamCase kFewReturns = {.seed = 41,
                                    .tool = "builtin:pencil",
                                    .voxel_size_m = 0.05,
                                    .frames = 60,
                                    .rays_per_frame = 1500,
                                    .max_range_m = 2.5,
                                    .length_m = 0.1};
constexpr StreamCase kFewReturnsSeldom = {.seed = 41,
                                          .tool = "builtin:pencil",
                                          .voxel_size_m = 0.03,
                                          .scans_an_update = 2,
                                          .frames = 44,
                                          .rays_per_frame = 8000,
                                          .max_range_m = 2.5,
                                          .length_m = 0.1};

std::size_t blockedByTheTool(const FieldSnapshot& field) {
  return static_cast<std::size_t>(
      std::ranges::count(field.points, PointReason::Tool, [](const SurfacePoint& p) { return p.reason; }));
}

// Voxels so small that the device takes 2^3 and 4^3 blocks at a time. Returns from close by, with noise of several
// voxels, so that voxels get more than one and stop colliding.
constexpr StreamCase kGroupsOf8 = {.seed = 10,
                                   .tool = "builtin:pruner",
                                   .voxel_size_m = 0.005,
                                   .max_collisions = 20,  // the rule would allow a few thousand
                                   .directions = 80,      // enough for their slabs to be kept by row
                                   .frames = 10,
                                   .rays_per_frame = 8000,
                                   .range_noise_m = 0.01,
                                   .max_range_m = 2.5,
                                   .length_m = 0.3};
constexpr StreamCase kGroupsOf64 = {.seed = 11,
                                    .tool = "builtin:pencil",
                                    .voxel_size_m = 0.0025,
                                    .frames = 10,
                                    .rays_per_frame = 8000,
                                    .range_noise_m = 0.01,
                                    .max_range_m = 2.5,
                                    .length_m = 0.3};
/// A short version for the sanitizers, with so many directions that a point has fewer slots than words.
constexpr StreamCase kShortGroups = {.seed = 2,
                                     .tool = "builtin:pencil",
                                     .voxel_size_m = 0.005,
                                     .directions = 120,
                                     .frames = 5,
                                     .rays_per_frame = 6000,
                                     .range_noise_m = 0.01,
                                     .max_range_m = 2,
                                     .length_m = 0.1};

/// A limit so high that a step of what is remembered has more than eight collisions, and freed voxels are not counted
/// one by one (FreedWord).
constexpr StreamCase kHighLimit = {.seed = 7, .tool = "builtin:pruner", .voxel_size_m = 0.02, .max_collisions = 400};

AccessibilityField fieldOn(const StreamCase& c, BackendKind backend) {
  FieldParams params = paramsOf(c);
  params.backend = backend;
  return AccessibilityField(ToolGeometry::builtin(c.tool), params);
}
/// A stream's field on the processor and on the GPU.
struct OnBoth {
  AccessibilityField cpu, cuda;
  explicit OnBoth(const StreamCase& c) : cpu(fieldOn(c, BackendKind::Cpu)), cuda(fieldOn(c, BackendKind::Cuda)) {}
};

class CudaStream : public GpuTest, public testing::WithParamInterface<StreamCase> {};

TEST_P(CudaStream, EqualsTheCpuAfterEveryUpdate) {
  const StreamCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  OnBoth fields(c);
  auto& [cpu, cuda] = fields;
  EXPECT_EQ(cuda.deviceName().rfind("cuda:", 0), 0u) << cuda.deviceName();
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    cuda.integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    const UpdateStats a = cpu.update(), b = cuda.update();
    // With the exact policy the device finds more points due, from coarser facts: more is tested, with the same
    // outcome.
    if (c.policy == UpdatePolicy::Paper) {
      ASSERT_EQ(a.direction_tests, b.direction_tests);
    }
    ASSERT_EQ(a.label_changes, b.label_changes);
    ASSERT_EQ(a.backlog, b.backlog);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  expectSame(cpu.evaluateFromScratch(), cuda.evaluateFromScratch());
  expectVaried(cuda.snapshot());
  EXPECT_GT(cuda.memoryUse().device_peak_bytes, cuda.memoryUse().point_device_bytes);
  EXPECT_EQ(cpu.memoryUse().device_peak_bytes, 0u);
}

/// Each scan comes beside the update of the one before, now and then with something in between that waits.
TEST_P(CudaStream, PipelinedEqualsTheCpu) {
  const StreamCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  OnBoth fields(c);
  auto& [cpu, cuda] = fields;
  UpdateTicket ticket;
  UpdateStats expected;
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    const FrameStats stats = cuda.integrateScan(scan.points_S, scan.T_W_S);
    EXPECT_GT(stats.points_used, 0u);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    if (ticket.valid()) {
      const UpdateStats done = ticket.wait();
      ASSERT_EQ(done.label_changes, expected.label_changes);
      ASSERT_EQ(done.backlog, expected.backlog);
    }
    expected = cpu.update();
    ticket = cuda.updateAsync();
    if (frame % 5 == 3) expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  expectSame(cpu.snapshot(), cuda.snapshot());
  expectSameMap(cpu.volume(), cuda.volume());
  expectVaried(cuda.snapshot());
}

INSTANTIATE_TEST_SUITE_P(
    Streams, CudaStream,
    testing::Values(StreamCase{.seed = 1, .tool = "builtin:pruner", .voxel_size_m = 0.05},
                    StreamCase{.seed = 2, .tool = "builtin:pencil", .voxel_size_m = 0.02},
                    StreamCase{.seed = 3, .tool = "builtin:pruner", .voxel_size_m = 0.02},
                    StreamCase{
                        .seed = 4, .tool = "builtin:pruner", .voxel_size_m = 0.05, .policy = UpdatePolicy::Paper},
                    StreamCase{.seed = 5,
                               .tool = "builtin:pruner",
                               .voxel_size_m = 0.05,
                               .form = ToolForm::SurfaceSamples,
                               .max_collisions = 3},
                    StreamCase{.seed = 6,
                               .tool = "builtin:pruner",
                               .voxel_size_m = 0.04,
                               .policy = UpdatePolicy::Paper,
                               .max_collisions = 30,
                               .budget_points = 700},
                    StreamCase{.seed = 7, .tool = "builtin:pruner", .voxel_size_m = 0.05, .scans_an_update = 3},
                    StreamCase{.seed = 8,
                               .tool = "builtin:pruner",
                               .voxel_size_m = 0.04,
                               .max_collisions = 12,
                               .scans_an_update = 2,
                               .neighbours = 200,
                               .directions = 256},
                    StreamCase{.seed = 9, .tool = "builtin:pruner", .voxel_size_m = 0.05, .neighbours = 400}));

INSTANTIATE_TEST_SUITE_P(
    Orientations, CudaStream,
    testing::Values(
        StreamCase{.seed = 21, .tool = "builtin:pruner", .voxel_size_m = 0.05, .orientations = "sphere:12.5"},
        StreamCase{.seed = 22, .tool = "builtin:pencil", .voxel_size_m = 0.02, .orientations = "sphere:12.5"},
        StreamCase{.seed = 23,
                   .tool = "builtin:pruner",
                   .voxel_size_m = 0.04,
                   .max_collisions = 12,
                   .scans_an_update = 2,
                   .directions = 36,
                   .orientations = "pitch:-30:30:10"},
        StreamCase{.seed = 24,
                   .tool = "builtin:pruner",
                   .voxel_size_m = 0.05,
                   .form = ToolForm::SurfaceSamples,
                   .max_collisions = 3,
                   .orientations = "sphere:15"},
        // One roll on slabs; by rule the pruner has six, on columns.
        StreamCase{
            .seed = 27, .tool = "builtin:pruner", .voxel_size_m = 0.05, .orientations = "sphere:12.5", .rolls = 1},
        StreamCase{.seed = 28,
                   .tool = "builtin:pruner",
                   .voxel_size_m = 0.04,
                   .max_collisions = 12,
                   .scans_an_update = 2,
                   .orientations = "sphere:20",
                   .rolls = 12},
        StreamCase{.seed = 29, .tool = "builtin:pruner", .voxel_size_m = 0.05, .directions = 36, .rolls = 4},
        // Groups of 2^3 blocks, in which a set of directions belongs to each leaf and cell.
        StreamCase{.seed = 25,
                   .tool = "builtin:pruner",
                   .voxel_size_m = 0.005,
                   .max_collisions = 20,
                   .frames = 8,
                   .rays_per_frame = 8000,
                   .range_noise_m = 0.01,
                   .max_range_m = 2.5,
                   .length_m = 0.3,
                   .orientations = "sphere:30"},
        // Wide sets: the host decides what is due.
        StreamCase{.seed = 31, .tool = "builtin:pruner", .voxel_size_m = 0.06, .orientations = "sphere:9"},
        StreamCase{.seed = 32,
                   .tool = "builtin:pruner",
                   .voxel_size_m = 0.05,
                   .scans_an_update = 2,
                   .frames = 8,
                   .orientations = "sphere:3.8",
                   .rolls = 1},
        // Yaw by the general way.
        StreamCase{.seed = 1, .tool = "builtin:pruner", .voxel_size_m = 0.05, .orientations = "pitch:0:0:1"}));

INSTANTIATE_TEST_SUITE_P(GroupedStreams, CudaStream, testing::Values(kGroupsOf8, kGroupsOf64));
INSTANTIATE_TEST_SUITE_P(FewReturns, CudaStream, testing::Values(kFewReturns, kFewReturnsSeldom));
INSTANTIATE_TEST_SUITE_P(ThickTool, CudaStream, testing::Values(kThickTool));
INSTANTIATE_TEST_SUITE_P(HighLimit, CudaStream, testing::Values(kHighLimit));

// tools/gpu_suite.sh runs it under compute-sanitizer.
INSTANTIATE_TEST_SUITE_P(ShortStream, CudaStream,
                         testing::Values(kShortStream, kShortGroups, kShortThickTool, kShortSphere, kShortWide));

internal::ToolSlabs slabsOf(const StreamCase& c) {
  const auto kernel = internal::ToolKernel::make(ToolGeometry::builtin(c.tool), paramsOf(c).resolved());
  return internal::ToolSlabs::make(kernel.view(), c.directions, internal::ToolSlabs::Limits());
}

/// Points that stayed accessible while their score rose.
struct Risen {
  std::size_t same_direction = 0, other_direction = 0;

  void add(const FieldSnapshot& before, const FieldSnapshot& after) {
    for (std::size_t n = 0; n < before.points.size(); ++n) {
      const SurfacePoint &a = before.points[n], &b = after.points[n];
      if (a.label != PointLabel::Accessible || b.label != PointLabel::Accessible || b.score <= a.score) continue;
      ++(a.direction == b.direction ? same_direction : other_direction);
    }
  }
};

/// The stream on the CPU; checks that each update tests more directions than that.
FieldSnapshot busyStream(const StreamCase& c, std::uint64_t tests, Risen* risen = nullptr) {
  AccessibilityField field = fieldOn(c, BackendKind::Cpu);
  const WalkGenerator walk = walkOf(c);
  FieldSnapshot before;
  for (int frame = 0; frame < c.frames; ++frame) {
    const WalkFrame scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    const UpdateStats stats = field.update();
    EXPECT_GT(stats.direction_tests, tests) << "update " << frame;
    FieldSnapshot after = field.snapshot();
    if (risen != nullptr && frame > 0) risen->add(before, after);
    before = std::move(after);
  }
  return before;
}

/// MovedCounters::mostlyKnown(): else all would be searched.
TEST(FewReturns, AreMostlyOfPointsThatWereThere) {
  for (const StreamCase& c : {kFewReturns, kFewReturnsSeldom}) {
    const WalkGenerator walk = walkOf(c);
    AccessibilityField field = fieldOn(c, BackendKind::Cpu);
    int mostly_known = 0;
    std::uint64_t points = 0, returns = 0;
    for (int frame = 0; frame < c.frames; ++frame) {
      const WalkFrame scan = walk.frame(frame);
      const FrameStats stats = field.integrateScan(scan.points_S, scan.T_W_S);
      returns += stats.points_used;
      if ((frame + 1) % c.scans_an_update != 0) continue;
      // Some returns share a point, also with those of another scan: no more than three, on average.
      mostly_known += 6 * (stats.surface_points - points) < returns ? 1 : 0;
      points = stats.surface_points;
      returns = 0;
    }
    EXPECT_GT(mostly_known, c.frames / c.scans_an_update / 4);
    EXPECT_GT(points, 500U);
  }
}

/// Checks that it contains what the sanitizers must see: searches that count a thick tool by its slabs. Needs no GPU.
TEST(ShortStream, HasAToolWithSlabsThatBlocks) {
  const internal::ToolSlabs slabs = slabsOf(kShortStream);
  ASSERT_FALSE(slabs.empty());
  EXPECT_GT(slabs.columns.size(), 64u * static_cast<std::size_t>(kShortStream.directions));
  const FieldSnapshot snapshot = busyStream(kShortStream, 1000);
  expectVaried(snapshot);
  EXPECT_GT(blockedByTheTool(snapshot), 50u);
}

/// Likewise for searches that meet leaves as a whole. Needs no GPU.
TEST(ThickTool, TakesLeavesAsAWholeAndBlocks) {
  for (const auto& [c, tests] : {std::pair{kThickTool, 1000u}, {kShortThickTool, 100u}}) {
    const internal::ToolSlabs slabs = slabsOf(c);
    EXPECT_TRUE(slabs.thick);
    EXPECT_GT(slabs.columns.size(), 0u);
    Risen risen;  // then directions are compared with ones not known to be worse
    const FieldSnapshot snapshot = busyStream(c, tests, &risen);
    expectVaried(snapshot);
    EXPECT_GT(blockedByTheTool(snapshot), 50u);
    EXPECT_GT(risen.same_direction, 5u);
    EXPECT_GT(risen.other_direction, 5u);
  }
}

/// Needs no GPU.
TEST(HighLimit, CountsFreedVoxelsByMoreThanOne) {
  EXPECT_GT(kernels::FreedWord::unitLog2(kernels::KnownLevels::forLimit(kHighLimit.max_collisions).log2), 0);
  const FieldSnapshot snapshot = busyStream(kHighLimit, 500);
  expectVaried(snapshot);
  EXPECT_GT(blockedByTheTool(snapshot), 50u);
}

/// The short stream of groups has fewer slots than words (KnownSlots). Needs no GPU.
TEST(GroupedStreams, HavePointsWithFewerSlotsThanWords) {
  const FieldParams params = paramsOf(kShortGroups).resolved();
  const int arc = kernels::mostInCone(kShortGroups.directions, std::cos(params.approach.normal_cone_rad));
  EXPECT_FALSE(kernels::KnownSlots::of(kShortGroups.directions, arc).all());
}

/// One of the streams counts slabs that are kept by row. Needs no GPU.
TEST(GroupedStreams, HaveAToolWhoseSlabsAreKeptByRow) {
  const internal::ToolSlabs slabs = slabsOf(kGroupsOf8);
  EXPECT_FALSE(slabs.rows.empty());
  EXPECT_TRUE(slabs.thick);
}

/// Where places are seen again, the device knows blocked corridors as well as the processor does: it asks about one
/// again only if a voxel of it may have become free. By leaf, it would test several times as many directions.
class CudaSeenAgain : public GpuTest {};
TEST_F(CudaSeenAgain, TestsHardlyMoreDirectionsThanTheCpu) {
  const StreamCase c = {.seed = 14,
                        .tool = "builtin:pruner",
                        .voxel_size_m = 0.02,
                        .frames = 24,
                        .rays_per_frame = 6000,
                        .max_range_m = 3,
                        .length_m = 0.05};
  OnBoth fields(c);
  auto& [cpu, cuda] = fields;
  const WalkGenerator walk = walkOf(c);
  std::uint64_t by_cpu = 0, by_cuda = 0;
  for (int frame = 0; frame < c.frames; ++frame) {
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(a.label_changes, b.label_changes) << "frame " << frame;
    if (frame < c.frames / 2) continue;
    by_cpu += a.direction_tests;
    by_cuda += b.direction_tests;
  }
  expectSame(cpu.snapshot(), cuda.snapshot());
  EXPECT_GT(by_cpu, 10000u);
  EXPECT_LT(by_cuda, 2 * by_cpu) << "of " << by_cpu;
  std::printf("tests: %llu on the processor, %llu on the device\n", static_cast<unsigned long long>(by_cpu),
              static_cast<unsigned long long>(by_cuda));
}

/// Checks that they contain what they must show: groups of several blocks, and points of all kinds. Needs no GPU.
TEST(GroupedStreams, HaveGroupsOfBlocksAndBlockedPoints) {
  for (const StreamCase& c : {kGroupsOf8, kGroupsOf64, kShortGroups}) {
    SCOPED_TRACE(testing::PrintToString(c));
    const int log2 = internal::blockGroupLog2(c.voxel_size_m);
    EXPECT_EQ(log2, c.voxel_size_m > 0.004 ? 1 : 2);
    AccessibilityField field = fieldOn(c, BackendKind::Cpu);
    const WalkGenerator walk = walkOf(c);
    for (int frame = 0; frame < c.frames; ++frame) {
      const WalkFrame scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      const UpdateStats stats = field.update();
      if (frame > 1) {
        EXPECT_GT(stats.direction_tests, 500u) << "update " << frame;
        EXPECT_GT(stats.label_changes, 20u) << "update " << frame;
      }
    }
    const FieldSnapshot snapshot = field.snapshot();
    expectVaried(snapshot);
    EXPECT_GT(blockedByTheTool(snapshot), 20u);
    std::set<std::array<std::int64_t, 3>> blocks, groups;
    for (const SurfacePoint& point : snapshot.points) {
      const auto at = [&](int axis, double edge_m) {
        return static_cast<std::int64_t>(std::floor(point.position_W[axis] / edge_m + 0.5));
      };
      const double block_m = 8 * c.voxel_size_m, group_m = (8 << log2) * c.voxel_size_m;
      blocks.insert({at(0, block_m), at(1, block_m), at(2, block_m)});
      groups.insert({at(0, group_m), at(1, group_m), at(2, group_m)});
    }
    EXPECT_GT(blocks.size(), 3 * groups.size() / 2);
  }
}

}  // namespace
}  // namespace accessvdb::test
