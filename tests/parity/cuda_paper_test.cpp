// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// The paper's policy on the GPU: queue, candidates and scores are the device's, and after every update the same points
// have been evaluated with the same outcome as on the CPU. A best score never rises, so one point out of turn would
// show.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "support/determinism_support.h"

namespace accessvdb::test {
namespace {

struct PaperCase {
  std::uint64_t seed;
  bool paper_profile;  ///< with viewpoints, 20 degree steps and samples of the tool
  double voxel_size_m;
  int budget_points = 0;
  int scans_an_update = 1;
  int frames = 14;
  int rays_per_frame = 4000;
  int directions = 180;
};
void PrintTo(const PaperCase& c, std::ostream* out) {
  *out << (c.paper_profile ? "paper" : "product") << " profile at " << c.voxel_size_m << " m, " << c.budget_points
       << " points an update, " << c.scans_an_update << " scans an update";
}

WalkGenerator walkOf(const PaperCase& c) {
  WalkOptions options = parityWalk(c.seed, c.frames, c.rays_per_frame);
  options.max_range_m = 6;
  options.length_m = 2;  // short, so that points are seen repeatedly
  return WalkGenerator(options);
}

FieldParams paramsOf(const PaperCase& c, BackendKind backend) {
  FieldParams params = c.paper_profile ? FieldParams::paper(c.voxel_size_m) : FieldParams{};
  params.tsdf.voxel_size_m = c.voxel_size_m;
  params.scoring.surface_samples = 200;
  // With the paper's other definition of a collision, almost nothing collides at such voxels.
  params.scoring.collision_distance_m = 0;
  params.approach.num_directions = c.directions;
  params.update.policy = UpdatePolicy::Paper;
  params.update.budget_points = c.budget_points;
  params.backend = backend;
  return params;
}

class CudaPaper : public GpuTest, public testing::WithParamInterface<PaperCase> {};

TEST_P(CudaPaper, EvaluatesTheSamePointsAsTheCpu) {
  const PaperCase& c = GetParam();
  const WalkGenerator walk = walkOf(c);
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pruner");
  AccessibilityField cpu(tool, paramsOf(c, BackendKind::Cpu)), cuda(tool, paramsOf(c, BackendKind::Cuda));
  std::uint64_t backlog = 0, tests = 0, again = 0;
  const auto update = [&] {
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(a.dirty_points, b.dirty_points);
    ASSERT_EQ(a.moved_points, b.moved_points);
    ASSERT_EQ(a.scored_points, b.scored_points);
    ASSERT_EQ(a.direction_tests, b.direction_tests);
    ASSERT_EQ(a.label_changes, b.label_changes);
    ASSERT_EQ(a.backlog, b.backlog);
    expectSame(cpu.snapshot(), cuda.snapshot());
    backlog = std::max(backlog, a.backlog);
    tests += a.direction_tests;
    again += a.dirty_points;
  };
  for (int frame = 0; frame < c.frames; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    cuda.integrateScan(scan.points_S, scan.T_W_S);
    if ((frame + 1) % c.scans_an_update == 0) update();
    if (HasFatalFailure()) return;
  }
  for (int turn = 0; turn < 3; ++turn) {
    update();  // between scans
    if (HasFatalFailure()) return;
  }
  EXPECT_EQ(backlog > 0, c.budget_points > 0);
  EXPECT_GT(tests, 5000u);
  const std::uint64_t scored = cpu.snapshot().points.size() - cpu.snapshot().count(PointLabel::Unscored);
  if (c.budget_points == 0) {
    EXPECT_GT(again, 3 * scored / 2);  // triggers queued points again
  }
  expectVaried(cuda.snapshot());
}

INSTANTIATE_TEST_SUITE_P(
    Streams, CudaPaper,
    testing::Values(
        PaperCase{.seed = 1, .paper_profile = true, .voxel_size_m = 0.05},
        PaperCase{.seed = 2, .paper_profile = true, .voxel_size_m = 0.04, .budget_points = 600},
        PaperCase{.seed = 3, .paper_profile = false, .voxel_size_m = 0.05},
        PaperCase{.seed = 4, .paper_profile = false, .voxel_size_m = 0.05, .budget_points = 600},
        PaperCase{.seed = 5, .paper_profile = true, .voxel_size_m = 0.05, .budget_points = 600, .scans_an_update = 3},
        PaperCase{.seed = 6, .paper_profile = true, .voxel_size_m = 0.02, .scans_an_update = 2, .frames = 8}));

// tools/gpu_suite.sh runs it under compute-sanitizer.
INSTANTIATE_TEST_SUITE_P(ShortStream, CudaPaper,
                         testing::Values(PaperCase{.seed = 9,
                                                   .paper_profile = true,
                                                   .voxel_size_m = 0.06,
                                                   .budget_points = 300,
                                                   .frames = 4,
                                                   .rays_per_frame = 1500,
                                                   .directions = 36}));

}  // namespace
}  // namespace accessvdb::test
