// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Fields that score one point where the surface is, on the GPU against the CPU: after every update all points are the
// same, bit for bit, and so is which of them are beside the surface.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/access_map.h"
#include "accessvdb/region.h"
#include "accessvdb/tool_spec.h"
#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"
#include "support/waiting_points.h"

namespace accessvdb::test {
namespace {

struct SurfaceCase {
  std::uint64_t seed;
  double voxel_size_m, noise_m, spacing_m;
  const char* tool = "builtin:pruner";
  int neighbours = 0;
  int scans_an_update = 1;
  int max_collisions = 0;
  int directions = 36;
  int frames = 12;
  int rays_per_frame = 4000;
  double max_range_m = 8, length_m = 4;
  double origin_x_m = 0;  ///< of the local frame
  ToolForm form = ToolForm::Voxels;
  const char* orientations = "yaw";
};
void PrintTo(const SurfaceCase& c, std::ostream* out) {
  *out << c.tool << " at " << c.voxel_size_m << " m, noise " << c.noise_m << ", points " << c.spacing_m
       << " m apart, neighbours " << c.neighbours << ", " << c.scans_an_update << " scans an update, "
       << c.orientations;
}

WalkGenerator walkOf(const SurfaceCase& c) {
  WalkOptions options = parityWalk(c.seed, c.frames, c.rays_per_frame);
  options.range_noise_m = c.noise_m;
  options.max_range_m = c.max_range_m;
  options.length_m = c.length_m;
  return WalkGenerator(options);
}

FieldParams paramsOf(const SurfaceCase& c, BackendKind backend) {
  FieldParams params;
  params.tsdf.voxel_size_m = c.voxel_size_m;
  params.tsdf.range_noise_m = c.noise_m;
  params.scoring.point_spacing_m = c.spacing_m;
  params.scoring.form = c.form;
  params.scoring.surface_samples = 200;
  params.scoring.max_collisions = c.max_collisions;
  params.scoring.neighbours = c.neighbours;
  params.approach.num_directions = c.directions;
  params.approach.orientations = OrientationSet::parse(c.orientations);
  if (c.origin_x_m != 0) params.origin_W = {c.origin_x_m, 0, 0};
  params.backend = backend;
  return params;
}

AccessibilityField fieldOn(const SurfaceCase& c, BackendKind backend) {
  return AccessibilityField(ToolGeometry::builtin(c.tool), paramsOf(c, backend));
}

std::uint64_t beside(const FieldSnapshot& field) {
  return field.reasons()[static_cast<std::size_t>(PointReason::BesideSurface)];
}

/// How often points that were beside the surface came to be scored, and the other way.
struct Turns {
  std::size_t chosen = 0, left = 0;

  void add(const FieldSnapshot& before, const FieldSnapshot& now) {
    for (std::size_t n = 0; n < before.points.size(); ++n) {
      const bool was_beside = before.points[n].reason == PointReason::BesideSurface,
                 is_beside = now.points[n].reason == PointReason::BesideSurface;
      chosen += was_beside && now.points[n].label != PointLabel::Unscored ? 1 : 0;
      left += before.points[n].label != PointLabel::Unscored && is_beside ? 1 : 0;
    }
  }
};

// Noise of about a voxel and of several; cells of a voxel and of several; neighbours by the cell and by the point, a
// few so near that points compete with others far beyond them; groups of blocks; far from the origin, where means are
// rounded.
const SurfaceCase kSurfaces[] = {
    {.seed = 1, .voxel_size_m = 0.05, .noise_m = 0.02, .spacing_m = 0.05},
    {.seed = 2, .voxel_size_m = 0.02, .noise_m = 0.04, .spacing_m = 0.04, .max_collisions = 40},
    {.seed = 3, .voxel_size_m = 0.03, .noise_m = 0.02, .spacing_m = 0.06, .tool = "builtin:pencil"},
    {.seed = 4, .voxel_size_m = 0.05, .noise_m = 0.05, .spacing_m = 0.2, .scans_an_update = 3},
    {.seed = 5, .voxel_size_m = 0.04, .noise_m = 0.08, .spacing_m = 0.04, .neighbours = 3, .directions = 180},
    {.seed = 6,
     .voxel_size_m = 0.04,
     .noise_m = 0.03,
     .spacing_m = 0.08,
     .neighbours = 400,
     .scans_an_update = 2,
     .max_collisions = 12},
    {.seed = 7,
     .voxel_size_m = 0.05,
     .noise_m = 0.02,
     .spacing_m = 0.05,
     .max_collisions = 3,
     .form = ToolForm::SurfaceSamples},
    {.seed = 8, .voxel_size_m = 0.05, .noise_m = 0.03, .spacing_m = 0.1, .orientations = "sphere:15"},
    {.seed = 9,
     .voxel_size_m = 0.005,
     .noise_m = 0.01,
     .spacing_m = 0.01,
     .max_collisions = 20,
     .frames = 8,
     .rays_per_frame = 8000,
     .max_range_m = 2.5,
     .length_m = 0.3},
    {.seed = 10, .voxel_size_m = 0.02, .noise_m = 0.02, .spacing_m = 0.06, .max_collisions = 40, .origin_x_m = 9000},
    // The host decides what is due.
    {.seed = 11, .voxel_size_m = 0.06, .noise_m = 0.03, .spacing_m = 0.06, .orientations = "sphere:9"}};

/// Short enough for the sanitizers.
const SurfaceCase kShort = {
    .seed = 12, .voxel_size_m = 0.06, .noise_m = 0.05, .spacing_m = 0.12, .frames = 4, .rays_per_frame = 1500};

class CudaSurface : public GpuTest, public testing::WithParamInterface<SurfaceCase> {};

TEST_P(CudaSurface, EqualsTheCpuAfterEveryUpdate) {
  const SurfaceCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  AccessibilityField cpu = fieldOn(c, BackendKind::Cpu), cuda = fieldOn(c, BackendKind::Cuda);
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    ASSERT_EQ(cpu.update().label_changes, cuda.update().label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  expectSame(cpu.evaluateFromScratch(), cuda.evaluateFromScratch());
  const std::uint64_t unchanged = cuda.update().label_changes;  // nothing came
  EXPECT_EQ(unchanged, 0u);
  EXPECT_GT(beside(cuda.snapshot()), 50u);
}

/// Each scan comes beside the update of the one before.
TEST_P(CudaSurface, PipelinedEqualsTheCpu) {
  const SurfaceCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  AccessibilityField cpu = fieldOn(c, BackendKind::Cpu), cuda = fieldOn(c, BackendKind::Cuda);
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    cpu.update();
    static_cast<void>(cuda.updateAsync());
    if (frame % 5 == 3) expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  expectSame(cpu.snapshot(), cuda.snapshot());
}

/// Though every point then goes through the queue.
TEST_P(CudaSurface, ABudgetThatIsNeverReachedChangesNothing) {
  const SurfaceCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  AccessibilityField cpu = fieldOn(c, BackendKind::Cpu), cuda = fieldOn(c, BackendKind::Cuda);
  cuda.setBudgetPoints(1'000'000);
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update != 0) continue;
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(b.backlog, 0u);
    ASSERT_EQ(a.label_changes, b.label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
}

/// Points that wait may be chosen, and left again, before their turn comes. At any time exactly those are unscored.
TEST_P(CudaSurface, BudgetsOnlyDelay) {
  const SurfaceCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  AccessibilityField field = fieldOn(c, BackendKind::Cuda);
  WaitingModel model(true);
  std::uint64_t beside_waits = 0;
  const auto expectOnlyWaitingPointsWithheld = [&](const UpdateStats& stats) {
    const WaitingModel::Found found = model.compare(field.snapshot(), field.evaluateFromScratch());
    expectCounted(found, stats);
    beside_waits += found.beside;
  };
  const int budgets[] = {40, 200, 60, 0, 100};
  std::uint64_t most_waiting = 0;
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
    field.setBudgetPoints(budgets[frame % std::ssize(budgets)]);
    const UpdateStats stats = field.update();
    most_waiting = std::max(most_waiting, stats.backlog);
    expectOnlyWaitingPointsWithheld(stats);
    if (HasFailure()) return;
  }
  EXPECT_GT(most_waiting, 100u);
  EXPECT_GT(beside_waits, 20u);
  field.setBudgetPoints(0);
  const UpdateStats last = field.update();
  ASSERT_EQ(last.backlog, 0u);
  expectOnlyWaitingPointsWithheld(last);
}

INSTANTIATE_TEST_SUITE_P(Streams, CudaSurface, testing::ValuesIn(kSurfaces));
// tools/gpu_suite.sh runs it under compute-sanitizer.
INSTANTIATE_TEST_SUITE_P(ShortStream, CudaSurface, testing::Values(kShort));

class CudaSurfaceField : public GpuTest {};

/// Normals are shared, and so is which points are scored.
TEST_F(CudaSurfaceField, SeveralToolsEqualTheCpu) {
  const SurfaceCase c = {.seed = 21, .voxel_size_m = 0.05, .noise_m = 0.03, .spacing_m = 0.1};
  const std::vector<ToolSpec> tools = {{ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 1, {}, 0},
                                       {ToolGeometry::builtin("builtin:pencil"), OrientationSet::yaw(), 1, {}, 0},
                                       {ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(20), 1, {}, 0}};
  AccessibilityField cpu(tools, paramsOf(c, BackendKind::Cpu)), cuda(tools, paramsOf(c, BackendKind::Cuda));
  const WalkGenerator walk = walkOf(c);
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
    ASSERT_EQ(cpu.update().label_changes, cuda.update().label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    for (std::size_t k = 0; k < tools.size(); ++k) expectSame(cpu.toolSnapshot(k), cuda.toolSnapshot(k));
    if (HasFatalFailure()) return;
  }
  expectVaried(cuda.snapshot());
  EXPECT_GT(beside(cuda.snapshot()), 500u);
}

/// What is taken out by hand stays in its cell, and what comes afterwards competes with it; and a saved state goes on.
TEST_F(CudaSurfaceField, RemovalsAndSavedStatesEqualTheCpu) {
  const ScratchFolder folder;
  for (const RemovedAs as : {RemovedAs::Unknown, RemovedAs::Free}) {
    FieldParams params;
    params.tsdf.voxel_size_m = 0.04;
    params.tsdf.range_noise_m = 0.02;
    params.scoring.point_spacing_m = 0.08;
    params.approach.num_directions = 36;
    params.backend = BackendKind::Cpu;
    AccessibilityField cpu(armTool(), params);
    params.backend = BackendKind::Cuda;
    AccessibilityField cuda(armTool(), params);
    const auto both = [&](const auto& step) {
      for (AccessibilityField* field : {&cpu, &cuda}) step(*field);
    };
    const std::vector<Scan> scans = wallScans(5, 9, 1500);
    for (std::size_t n = 0; n < scans.size(); ++n) {
      SCOPED_TRACE("scan " + std::to_string(n));
      both([&](AccessibilityField& field) { field.integrateScan(scans[n].points_S, scans[n].T_W_S); });
      if (n == 3) {
        both([&](AccessibilityField& field) {
          field.update();
          field.removeRegion(Region::box({1.4, 0.3, 0.2}, {1.7, 0.7, 1.8}), as);
        });
      }
      if (n == 6) {
        // Each goes on where the other one was.
        cpu.saveState(folder / "cpu.avst");
        cuda.saveState(folder / "cuda.avst");
        AccessibilityField on_cpu = AccessibilityField::loadState(folder / "cuda.avst", armTool(), BackendKind::Cpu, 2);
        cuda = AccessibilityField::loadState(folder / "cpu.avst", armTool(), BackendKind::Cuda, 2);
        cpu = std::move(on_cpu);
      }
      both([&](AccessibilityField& field) { field.update(); });
      expectSame(cpu.snapshot(), cuda.snapshot());
      if (HasFatalFailure()) return;
    }
    expectVaried(cuda.snapshot());
    EXPECT_GT(beside(cuda.snapshot()), 200u);
  }
}

/// A noisy wall 2 m away, one return for each centimetre.
std::vector<Eigen::Vector3f> denseWall(std::uint64_t seed) {
  constexpr int kSide = 300;
  std::mt19937_64 random(seed);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < kSide; ++i) {
    for (int k = 0; k < kSide; ++k) {
      const auto across = [&](int n) { return 0.01 * (n - kSide / 2) + uniform(random, -0.004, 0.004); };
      points.push_back(Eigen::Vector3d(2 + uniform(random, -0.01, 0.01), across(i), across(k)).cast<float>());
    }
  }
  return points;
}

/// By one scan before an update, and by two.
TEST_F(CudaSurfaceField, MorePointsThanAreHandedOverAtATime) {
  constexpr std::uint64_t kAtATime = 1 << 16;  // src/update/device_admission.cpp
  const SurfaceCase c = {
      .seed = 23, .voxel_size_m = 0.01, .noise_m = 0.01, .spacing_m = 0.02, .tool = "builtin:pencil", .directions = 12};
  const auto fieldOf = [&](BackendKind backend) {
    FieldParams params = paramsOf(c, backend);
    params.scoring.confidence_min = 0;
    params.origin_W = {0, 0, 0};
    return AccessibilityField(ToolGeometry::builtin(c.tool), params);
  };
  AccessibilityField cpu = fieldOf(BackendKind::Cpu), cuda = fieldOf(BackendKind::Cuda);
  std::uint64_t seed = c.seed;
  for (const int scans : {1, 2, 1}) {
    SCOPED_TRACE(std::to_string(scans) + " scans");
    for (int n = 0; n < scans; ++n) {
      const std::vector<Eigen::Vector3f> points_S = denseWall(seed++);
      for (AccessibilityField* field : {&cpu, &cuda}) {
        ASSERT_GT(field->integrateScan(points_S, Eigen::Isometry3d::Identity()).points_used, kAtATime)
            << "each in a voxel of its own";
      }
    }
    ASSERT_EQ(cpu.update().label_changes, cuda.update().label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  const FieldSnapshot now = cuda.snapshot();
  EXPECT_GT(now.points.size(), 2 * kAtATime);
  EXPECT_GT(beside(now), 10000u);
  EXPECT_GT(now.count(PointLabel::Accessible) + now.count(PointLabel::Blocked), 5000u);
}

/// Why a point beside the surface is not scored, asked of both.
TEST_F(CudaSurfaceField, AccessMapsEqualTheCpu) {
  const SurfaceCase c = {.seed = 22, .voxel_size_m = 0.05, .noise_m = 0.03, .spacing_m = 0.1, .frames = 5};
  AccessibilityField cpu = fieldOn(c, BackendKind::Cpu), cuda = fieldOn(c, BackendKind::Cuda);
  const WalkGenerator walk = walkOf(c);
  for (int frame = 0; frame < c.frames; ++frame) {
    const WalkFrame scan = walk.frame(frame);
    for (AccessibilityField* field : {&cpu, &cuda}) field->integrateScan(scan.points_S, scan.T_W_S);
  }
  for (AccessibilityField* field : {&cpu, &cuda}) field->update();
  const FieldSnapshot snapshot = cpu.snapshot();
  std::size_t said_so = 0;
  for (std::size_t n = 0; n < snapshot.points.size(); n += 1 + snapshot.points.size() / 40) {
    const auto a = cpu.accessMap(snapshot.points[n].position_W), b = cuda.accessMap(snapshot.points[n].position_W);
    ASSERT_TRUE(a && b);
    ASSERT_EQ(a->directions.size(), b->directions.size());
    for (std::size_t d = 0; d < a->directions.size(); ++d) {
      ASSERT_EQ(a->directions[d].reason, b->directions[d].reason) << n;
      ASSERT_EQ(a->directions[d].score, b->directions[d].score) << n;
    }
    said_so += b->directions.front().reason == PointReason::BesideSurface ? 1 : 0;
  }
  EXPECT_GT(said_so, 5u);
}

/// Checks that the streams contain what they must show. Needs no GPU.
TEST(SurfaceStreams, HavePointsThatAreChosenAndLeft) {
  std::vector<SurfaceCase> cases(std::begin(kSurfaces), std::end(kSurfaces));
  cases.push_back(kShort);
  for (const SurfaceCase& c : cases) {
    SCOPED_TRACE(testing::PrintToString(c));
    AccessibilityField field = fieldOn(c, BackendKind::Cpu);
    const WalkGenerator walk = walkOf(c);
    FieldSnapshot before;
    Turns turns;
    for (int frame = 0; frame < c.frames; ++frame) {
      const WalkFrame scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
      if ((frame + 1) % c.scans_an_update != 0) continue;
      field.update();
      FieldSnapshot now = field.snapshot();
      turns.add(before, now);
      before = std::move(now);
    }
    const bool is_short = c.frames < 8;
    EXPECT_GT(beside(before), 50u);
    EXPECT_GT(turns.chosen, is_short ? 5u : 20u);
    EXPECT_GT(turns.left, is_short ? 5u : 20u);
    EXPECT_GT(before.count(PointLabel::Accessible), 50u);
    EXPECT_GT(before.count(PointLabel::Blocked), 20u);
  }
}

}  // namespace
}  // namespace accessvdb::test
