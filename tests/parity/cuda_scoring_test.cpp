// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
// CUDA against the CPU on random maps and points: every field of every result, and the stored state, bit for bit.
#include <gtest/gtest.h>

#include <array>

#include "hostdev/direction_score.h"
#include "parity/gpu_test.h"
#include "parity/scoring_rig.h"

namespace accessvdb::test {
namespace {

using kernels::CudaOptions;
using kernels::SearchPath;

class CudaScoring : public GpuTest {};

struct Tally {
  std::array<std::uint64_t, kNumPointReasons> reasons = {};
  std::uint64_t cut_short = 0, ended_early = 0, skipped = 0, collided = 0;

  void add(const std::vector<kernels::ScoreResult>& results, int directions) {
    for (const auto& result : results) {
      ++reasons[static_cast<std::size_t>(result.reason)];
      cut_short += result.least_blocked != kNoScore ? 1 : 0;
      ended_early += result.score == 0 && result.tests < directions / 4 ? 1 : 0;
      skipped += result.skipped;
      collided += result.score > 0 && result.score != kNoScore ? 1 : 0;
    }
  }
};

/// Scores the items three times, each time on the previous state, once by the paper's rule.
void compare(const ScoringCase& what, const std::vector<CudaOptions>& ways, Tally& tally) {
  ScoringRig cpu(kernels::makeCpuBackend(), what);
  std::vector<std::vector<kernels::ScoreResult>> expected;
  std::vector<StoredState> states;
  for (const bool keep_best : {false, true, false}) {
    expected.push_back(cpu.score(what.items, keep_best));
    states.push_back(cpu.state());
  }
  tally.add(expected[0], what.params.approach.num_directions);
  expectBlockedIsTrue(cpu, what.items, expected[0]);
  for (const CudaOptions& way : ways) {
    SCOPED_TRACE("path " + std::to_string(static_cast<int>(way.path)) + ", chunks of " +
                 std::to_string(way.chunk_items));
    ScoringRig cuda(kernels::makeCudaBackend(way), what);
    int round = 0;
    for (const bool keep_best : {false, true, false}) {
      SCOPED_TRACE("round " + std::to_string(round));
      const std::vector<kernels::ScoreResult> results = cuda.score(what.items, keep_best);
      expectSameResults(results, expected[static_cast<std::size_t>(round)]);
      if (testing::Test::HasFatalFailure()) return;
      expectBlockedIsTrue(cpu, what.items, results);
      if (testing::Test::HasFatalFailure()) return;
      expectSameState(cuda.state(), states[static_cast<std::size_t>(round)]);
      if (testing::Test::HasFatalFailure()) return;
      ++round;
    }
  }
}

CudaOptions way(SearchPath path, std::uint32_t chunk_items = 1u << 16) {
  CudaOptions options;
  options.path = path;
  options.chunk_items = chunk_items;
  return options;
}

const std::vector<CudaOptions>& everyWay() {
  static const std::vector<CudaOptions> ways = {way(SearchPath::Plain), way(SearchPath::Tree), way(SearchPath::Lowers),
                                                way(SearchPath::Fast), way(SearchPath::Fast, 256)};
  return ways;
}

/// @param oriented  with sets of orientations that are not yaw
void runSeeds(std::uint64_t first, std::uint64_t last, bool samples, Tally& tally, bool oriented = false) {
  for (std::uint64_t seed = first; seed <= last && !testing::Test::HasFailure(); ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Random random(seed);
    FieldParams params = randomParams(random);
    if (oriented) chooseOrientations(random, params.approach);
    if (random.below(3) == 0) params.approach.corridor_length_m = 2;  // beyond the tool's window
    if (samples) {
      params.scoring.form = ToolForm::SurfaceSamples;
      params.scoring.surface_samples = 50 + random.below(300);
    }
    const ToolGeometry tool = randomTool(random, params.tsdf.voxel_size_m);
    compare(randomCase(random, tool, params, 700), everyWay(), tally);
  }
}

TEST_F(CudaScoring, EqualsTheCpuOnRandomMaps) {
  Tally tally;
  runSeeds(1, 30, false, tally);
  // The comparison is only meaningful if every outcome occurs.
  for (const PointReason reason : {PointReason::None, PointReason::Tool, PointReason::Arm, PointReason::Unknown,
                                   PointReason::Normal, PointReason::Unseen}) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 40u) << name(reason);
  }
  EXPECT_GT(tally.cut_short, 500u);
  EXPECT_GT(tally.ended_early, 100u);
  EXPECT_GT(tally.skipped, 500u);
  EXPECT_GT(tally.collided, 500u);
}

TEST_F(CudaScoring, SurfaceSamplesEqualTheCpuOnRandomMaps) {
  Tally tally;
  runSeeds(1001, 1012, true, tally);
  EXPECT_GT(tally.reasons[static_cast<std::size_t>(PointReason::None)], 40u);
  EXPECT_GT(tally.reasons[static_cast<std::size_t>(PointReason::Tool)], 40u);
}

TEST_F(CudaScoring, OrientationsEqualTheCpuOnRandomMaps) {
  Tally tally;
  runSeeds(2001, 2020, false, tally, true);
  runSeeds(2101, 2104, true, tally, true);
  for (const PointReason reason : {PointReason::None, PointReason::Tool, PointReason::Arm, PointReason::Unknown}) {
    EXPECT_GT(tally.reasons[static_cast<std::size_t>(reason)], 40u) << name(reason);
  }
  EXPECT_GT(tally.cut_short, 500u);
  EXPECT_GT(tally.skipped, 500u);
}

/// A tool that rolls: the same numbers, and the same first roll.
TEST_F(CudaScoring, RollsEqualTheCpu) {
  for (const bool samples : {false, true}) {
    for (const int rolls : {2, 6, 12}) {
      SCOPED_TRACE(std::to_string(rolls) + " rolls");
      Random random(static_cast<std::uint64_t>(60 + rolls));
      FieldParams params;
      params.tsdf.voxel_size_m = 0.05;
      params.scoring.max_collisions = 12;
      params.approach.orientations = OrientationSet::sphere(20);
      params.approach.rolls = rolls;
      params.scoring.form = samples ? ToolForm::SurfaceSamples : ToolForm::Voxels;
      params.scoring.surface_samples = 100;
      Tally tally;
      const ScoringCase what = randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 600);
      compare(what, everyWay(), tally);
      ScoringRig cpu(kernels::makeCpuBackend(), what);
      std::size_t rolled = 0;
      for (const kernels::ScoreResult& result : cpu.score(what.items, false)) rolled += result.roll > 0 ? 1 : 0;
      EXPECT_GT(rolled, 20u);
    }
  }
}

/// Small enough for the sanitizers, yet uses every kernel.
TEST_F(CudaScoring, ShortRunOfEveryPath) {
  for (const auto& [samples, rolls] : {std::pair{false, 1}, {true, 1}, {false, 3}, {true, 3}}) {
    Random random(31);
    FieldParams params;
    params.tsdf.voxel_size_m = 0.05;
    params.approach.num_directions = 36;
    params.approach.rolls = rolls;
    params.scoring.form = samples ? ToolForm::SurfaceSamples : ToolForm::Voxels;
    params.scoring.surface_samples = 100;
    Tally tally;
    compare(randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 150), everyWay(), tally);
    EXPECT_GT(tally.cut_short, rolls == 1 ? 5u : 0u);
  }
}

TEST_F(CudaScoring, AToolBeyondSharedMemoryEqualsTheCpu) {
  Random random(5);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.004;
  params.tsdf.range_noise_m = 0;  // a short corridor, so that many directions reach the tool
  params.scoring.max_collisions = 2;
  params.approach.num_directions = 8;
  const ScoringCase what = randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 300);
  Tally tally;
  compare(what, {way(SearchPath::Fast)}, tally);
  EXPECT_GT(tally.cut_short, 20u);
}

/// Count for count: the fast counting against the plain rule on the host, without early stop.
TEST_F(CudaScoring, CountsOfEveryDirectionEqualThePlainRule) {
  for (const bool samples : {false, true}) {
    for (const SearchPath path : {SearchPath::Fast, SearchPath::Lowers, SearchPath::Tree}) {
      Random random(77);
      FieldParams params;
      params.tsdf.voxel_size_m = 0.05;
      params.approach.num_directions = 36;
      params.scoring.form = samples ? ToolForm::SurfaceSamples : ToolForm::Voxels;
      const ScoringCase what = randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 200);
      ScoringRig cpu(kernels::makeCpuBackend(), what);
      ScoringRig cuda(kernels::makeCudaBackend(way(path)), what);
      auto& backend = dynamic_cast<kernels::CudaBackend&>(cuda.backend());
      kernels::ScoreRequest request = cuda.request(false);
      request.items = what.items.data();
      request.count = what.items.size();
      std::vector<std::uint16_t> counts(what.items.size() * 36);
      backend.countCollisions(request, counts.data());
      const kernels::ScoreRequest host = cpu.request(false);
      const kernels::OccupancyReader map(host.map);
      std::uint64_t total = 0;
      for (std::size_t n = 0; n < what.items.size(); ++n) {
        const float* p = host.points.position_L + 3 * std::size_t{what.items[n].id};
        const kernels::Coord ijk = kernels::voxelOf(p[0], p[1], p[2], host.map.inverse_voxel_size);
        for (int d = 0; d < 36; ++d) {
          const int expected =
              samples ? kernels::countSampleCollisions(map, host.tool, d, p, host.map.inverse_voxel_size, 1 << 30)
                      : kernels::countVoxelCollisions(map, host.tool, d, ijk, 1 << 30);
          ASSERT_EQ(counts[36 * n + static_cast<std::size_t>(d)], expected) << n << " " << d;
          total += static_cast<std::uint64_t>(expected);
        }
      }
      EXPECT_GT(total, 10000u);
    }
  }
}

TEST_F(CudaScoring, NothingToScoreIsNothing) {
  Random random(9);
  FieldParams params;
  params.tsdf.voxel_size_m = 0.05;
  ScoringCase what = randomCase(random, ToolGeometry::builtin("builtin:pruner"), params, 50);
  ScoringRig cuda(kernels::makeCudaBackend(), what);
  EXPECT_TRUE(cuda.score({}, false).empty());
  cuda.backend().writePoints(cuda.request(false).points, nullptr, 0);
}

}  // namespace
}  // namespace accessvdb::test
