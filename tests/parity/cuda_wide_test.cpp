// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// Wide sets of directions on CUDA against the CPU: every result, and the stored state, bit for bit.
#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "accessvdb/tool_spec.h"
#include "parity/gpu_test.h"
#include "parity/parity_walk.h"
#include "parity/scoring_rig.h"
#include "support/determinism_support.h"

namespace accessvdb::test {
namespace {

using kernels::CudaOptions;
using kernels::SearchPath;

class CudaWide : public GpuTest {};

struct WideTally {
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::uint64_t collided = 0, many_tests = 0, rolled = 0;
};

void compareWide(const ScoringCase& what, WideTally& tally) {
  ScoringRig cpu(kernels::makeCpuBackend(), what);
  const std::vector<kernels::ScoreResult> expected = cpu.score(what.items, false);
  for (const kernels::ScoreResult& result : expected) {
    ++tally.reasons[static_cast<std::size_t>(result.reason)];
    tally.collided += result.score > 0 && result.score != kNoScore ? 1 : 0;
    tally.many_tests += result.tests > 64 ? 1 : 0;
    tally.rolled += result.roll > 0 ? 1 : 0;
  }
  for (const auto& [path, chunk_items] :
       {std::pair{SearchPath::Fast, 1u << 16}, {SearchPath::Lowers, 256u}, {SearchPath::Tree, 1u << 16}}) {
    SCOPED_TRACE("path " + std::to_string(static_cast<int>(path)));
    CudaOptions options;
    options.path = path;
    options.chunk_items = chunk_items;
    ScoringRig cuda(kernels::makeCudaBackend(options), what);
    expectSameResults(cuda.score(what.items, false), expected);
    if (testing::Test::HasFatalFailure()) return;
    expectSameState(cuda.state(), cpu.state());
    if (testing::Test::HasFatalFailure()) return;
  }
}

FieldParams wideParams(const OrientationSet& set, double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.approach.orientations = set;
  params.scoring.max_collisions = 6;
  return params;
}

TEST_F(CudaWide, ScoresEqualTheCpuOnRandomMaps) {
  WideTally tally;
  std::uint64_t seed = 1;
  for (const OrientationSet& set : {OrientationSet::sphere(9), OrientationSet::sphere(3.8),
                                    OrientationSet::pitch(-60, 60, 20), OrientationSet::parse("sphere:15+yaw")}) {
    // At a right angle, all level directions may be in the cone of a normal that points upwards, with one cosine.
    for (const double cone_rad : {0.6, 1.2, 1.5707963267948966}) {
      for (const bool samples : {false, true}) {
        SCOPED_TRACE("seed " + std::to_string(seed));
        Random random(seed++);
        FieldParams params = wideParams(set, 0.06);
        ASSERT_GT(set.count(params.approach.num_directions), OrientationSet::kMostRemembered);
        params.approach.normal_cone_rad = cone_rad;
        params.approach.rolls = samples ? 1 : 3;
        params.scoring.form = samples ? ToolForm::SurfaceSamples : ToolForm::Voxels;
        params.scoring.surface_samples = 60;
        compareWide(randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 300), tally);
        if (HasFailure()) return;
      }
    }
  }
  for (const PointReason reason : {PointReason::None, PointReason::Tool, PointReason::Arm, PointReason::Unknown,
                                   PointReason::Normal, PointReason::Unseen}) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 20u) << name(reason);
  }
  EXPECT_GT(tally.collided, 500u);
  EXPECT_GT(tally.many_tests, 500u);
  EXPECT_GT(tally.rolled, 40u);
}

/// Small enough for the sanitizers.
TEST_F(CudaWide, ShortRun) {
  WideTally tally;
  Random random(7);
  compareWide(
      randomCase(random, ToolGeometry::builtin("builtin:pencil"), wideParams(OrientationSet::sphere(10), 0.06), 60),
      tally);
}

/// A tool with yaw, which the device updates itself, and two with a wide set, of which the host decides what is due.
TEST_F(CudaWide, SeveralToolsEqualTheCpu) {
  const std::vector<ToolSpec> tools = {{ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw(), 1, {}, 0},
                                       {ToolGeometry::builtin("builtin:pencil"), OrientationSet::sphere(9), 1, {}, 0},
                                       {ToolGeometry::builtin("builtin:pruner"), OrientationSet::sphere(9), 2, {}, 0}};
  FieldParams params;
  params.tsdf.voxel_size_m = 0.06;
  params.backend = BackendKind::Cpu;
  AccessibilityField cpu(tools, params);
  params.backend = BackendKind::Cuda;
  AccessibilityField cuda(tools, params);
  const WalkGenerator walk(parityWalk(41, 6, 3000));
  for (int frame = 0; frame < 6; ++frame) {
    SCOPED_TRACE("frame " + std::to_string(frame));
    const WalkFrame scan = walk.frame(frame);
    cpu.integrateScan(scan.points_S, scan.T_W_S);
    cuda.integrateScan(scan.points_S, scan.T_W_S);
    const UpdateStats a = cpu.update(), b = cuda.update();
    ASSERT_EQ(a.label_changes, b.label_changes);
    expectSame(cpu.snapshot(), cuda.snapshot());
    if (HasFatalFailure()) return;
  }
  const FieldSnapshot snapshot = cuda.snapshot();
  EXPECT_GT(snapshot.count(PointLabel::Accessible), 100u);
  EXPECT_GT(snapshot.count(PointLabel::Blocked), 20u);
}

}  // namespace
}  // namespace accessvdb::test
