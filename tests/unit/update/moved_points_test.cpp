// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// No changed neighbourhood is missed, compared with recomputing all of them after every scan.
#include "update/moved_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "unit/points/random_points.h"

namespace accessvdb::internal {
namespace {

using test::directionTable;
using test::pointParams;
using test::Random;

MapReads noMap() {
  MapReads reads;
  reads.weights = [](std::span<const std::uint32_t>, std::span<std::uint16_t> weights) {
    std::fill(weights.begin(), weights.end(), std::uint16_t{5});
  };
  return reads;
}

struct Stream {
  FieldParams params;
  double half_m = 0;   ///< extent of the scene
  double patch_m = 0;  ///< each scan sees a patch of this size
  Eigen::Vector3f centre = {0, 0, 0};
  std::size_t returns = 0;  ///< per scan
  std::size_t scans_an_update = 1;
  float step_m = 0;  ///< returns lie on a grid; 0: anywhere
};

struct Outcome {
  std::size_t changed = 0, moved = 0, all = 0;
  std::size_t chosen = 0, beside = 0;  ///< points that became scored, or ceased to be
};

/// Scans of a rough sheet from changing places. After each update every neighbourhood is recomputed, and those that
/// differ from the scorer's must be among the moved ones.
Outcome run(const Stream& stream, std::uint64_t seed) {
  Random random(seed);
  PointStore points(stream.params, directionTable(stream.params.approach.num_directions));
  const auto backend = kernels::makeCpuBackend();
  PointScorer scorer(points, stream.params, *backend, noMap());
  const NeighbourhoodSearch search(points, stream.params);
  MovedPoints moved_points(scorer);
  Outcome outcome;
  for (int update = 0; update < 12; ++update) {
    for (std::size_t scan = 0; scan < stream.scans_an_update; ++scan) {
      std::vector<Eigen::Vector3f> p;
      const Eigen::Vector3f patch = random.point(stream.half_m);
      for (std::size_t n = 0; n < stream.returns; ++n) {
        Eigen::Vector3f x = patch + random.point(stream.patch_m);
        x.z() = 0.2f * std::sin(2 * x.x()) + 0.02f * x.z();
        if (stream.step_m > 0) x = (x / stream.step_m).array().round().matrix() * stream.step_m;
        p.push_back(stream.centre + x);
      }
      const Eigen::Vector3f q = stream.centre + random.point(3);
      moved_points.note(points.addReturns(p, {&q, 1}));
    }
    const std::uint32_t known = scorer.device().size();  // earlier ones have a neighbourhood
    scorer.grow();
    // As if every third new point crossed the bound of confidence.
    std::vector<std::uint32_t> others;
    for (std::uint32_t id = known; id < points.size(); id += 3) others.push_back(id);
    std::vector<std::uint32_t> moved = moved_points.find(others);
    EXPECT_TRUE(std::ranges::is_sorted(moved, {}, [&](std::uint32_t id) { return points.blockOf(id); }));
    std::ranges::sort(moved);
    EXPECT_EQ(std::adjacent_find(moved.begin(), moved.end()), moved.end());
    const auto first_new = std::ranges::lower_bound(moved, known);
    EXPECT_TRUE(std::ranges::equal(std::span(first_new, moved.end()), others));
    moved.erase(first_new, moved.end());
    std::vector<std::uint32_t> ids(points.size());
    std::iota(ids.begin(), ids.end(), 0u);
    std::vector<Neighbourhood> now(ids.size());
    search.compute(ids, now);
    for (std::uint32_t id = 0; id < known; ++id) {
      const PointRecord& record = scorer.record(id);
      const auto beside = [](const Eigen::Vector3f& normal_L) { return kernels::besideSurfaceAxis(normal_L.data()); };
      const bool is_same = record.normal_L == now[id].normal_L && beside(record.normal_L) == beside(now[id].normal_L) &&
                           record.seen == now[id].seen && record.reach_m == now[id].reach_m;
      outcome.changed += is_same ? 0 : 1;
      outcome.chosen += beside(record.normal_L) >= 0 && beside(now[id].normal_L) < 0 ? 1 : 0;
      outcome.beside += beside(record.normal_L) < 0 && beside(now[id].normal_L) >= 0 ? 1 : 0;
      if (!is_same) {
        EXPECT_TRUE(std::binary_search(moved.begin(), moved.end(), id)) << "update " << update << " point " << id;
      }
    }
    outcome.moved += moved.size();
    outcome.all += known;
    if (testing::Test::HasFailure()) break;
    // Like the scheduler: the moved ones and the new ones.
    std::vector<std::uint32_t> refresh = moved;
    for (std::uint32_t id = known; id < points.size(); ++id) refresh.push_back(id);
    scorer.refreshNeighbourhoods(refresh);
    moved_points.refreshed(refresh);
    moved_points.clear();
  }
  return outcome;
}

void expectSelective(const Outcome& outcome) {
  EXPECT_GT(outcome.changed, 500u);
  EXPECT_LT(outcome.moved, outcome.all / 2);
  EXPECT_LT(outcome.moved, 2 * outcome.changed);  // not much more than what changed
}

TEST(MovedPoints, MissNoChangedNeighbourhood) {
  Stream stream;
  stream.params = pointParams(0.05);
  stream.half_m = 3;
  stream.patch_m = 0.8;
  stream.returns = 700;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) expectSelective(run(stream, seed));
}

TEST(MovedPoints, SeveralScansAnUpdate) {
  Stream stream;
  stream.params = pointParams(0.05, 36, 30);
  stream.half_m = 4;
  stream.patch_m = 0.5;
  stream.returns = 250;
  stream.scans_an_update = 3;
  expectSelective(run(stream, 4));
}

/// Where float32 has sixteen steps per voxel, means are outside their voxels.
TEST(MovedPoints, FarFromTheOrigin) {
  Stream stream;
  stream.params = pointParams(0.01);
  stream.half_m = 0.6;
  stream.patch_m = 0.15;
  stream.returns = 700;
  stream.centre = Eigen::Vector3f(-5000, 5100, 4900);
  const Outcome outcome = run(stream, 5);
  EXPECT_GT(outcome.changed, 500u);
}

/// First returns never move: then only new points and new views matter.
TEST(MovedPoints, WithoutMeansOnlyNewPointsAndViewsMatter) {
  Stream stream;
  stream.params = pointParams(0.05);
  stream.params.scoring.mean_positions = false;
  stream.half_m = 3;
  stream.patch_m = 0.8;
  stream.returns = 700;
  const Outcome outcome = run(stream, 6);
  EXPECT_GT(outcome.changed, 500u);
  EXPECT_LT(outcome.moved, outcome.all / 2);
}

/// Points that are not scored wait for those that they compete with, which may be farther away than any neighbour.
TEST(MovedPoints, MissNoPointThatCompetes) {
  struct Spacing {
    double spacing_m, noise_m;
    int neighbours;
  };
  // Of three neighbours the farthest is nearer than most that compete.
  for (const Spacing& spacing : {Spacing{0.05, 0.1, 3}, Spacing{0.15, 0.02, 3}, Spacing{0.05, 0.05, 30}}) {
    Stream stream;
    stream.params = pointParams(0.05, 36, spacing.neighbours);
    stream.params.tsdf.truncation_distance_m = 0.5;
    stream.params.tsdf.range_noise_m = spacing.noise_m;
    stream.params.scoring.point_spacing_m = spacing.spacing_m;
    stream.half_m = 3;
    stream.patch_m = 0.8;
    stream.returns = 700;
    Outcome all;
    for (std::uint64_t seed = 1; seed <= 3; ++seed) {
      const Outcome outcome = run(stream, seed);
      EXPECT_LT(outcome.moved, outcome.all / 2);
      all.chosen += outcome.chosen;
      all.beside += outcome.beside;
    }
    EXPECT_GT(all.chosen, 50u) << spacing.spacing_m;
    EXPECT_GT(all.beside, 50u) << spacing.spacing_m;
  }
}

/// Returns that are where earlier ones were move no mean, but are counted.
TEST(MovedPoints, ReturnsThatMoveNoMeanAreCounted) {
  Stream stream;
  stream.params = pointParams(0.05, 36, 3);
  stream.params.tsdf.truncation_distance_m = 0.5;
  stream.params.tsdf.range_noise_m = 0.1;
  stream.params.scoring.point_spacing_m = 0.05;
  stream.half_m = 0.2;
  stream.patch_m = 0.4;
  stream.returns = 300;
  stream.step_m = 0.0625f;  // a power of two, larger than a voxel: at most one place in each
  Outcome all;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const Outcome outcome = run(stream, seed);
    all.chosen += outcome.chosen;
    all.beside += outcome.beside;
  }
  EXPECT_GT(all.chosen, 20u);
  EXPECT_GT(all.beside, 20u);
}

}  // namespace
}  // namespace accessvdb::internal
