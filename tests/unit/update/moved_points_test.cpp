// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// No changed neighbourhood is missed, compared with recomputing all of them after every scan.
#include "update/moved_points.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

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
};

struct Outcome {
  std::size_t changed = 0, moved = 0, all = 0;
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
        p.push_back(stream.centre + x);
      }
      const Eigen::Vector3f q = stream.centre + random.point(3);
      moved_points.note(points.addReturns(p, {&q, 1}));
    }
    const std::uint32_t known = scorer.device().size();  // earlier ones have a neighbourhood
    scorer.grow();
    const std::vector<std::uint32_t> moved = moved_points.find();
    EXPECT_TRUE(std::is_sorted(moved.begin(), moved.end()));
    EXPECT_EQ(std::adjacent_find(moved.begin(), moved.end()), moved.end());
    std::vector<std::uint32_t> ids(points.size());
    std::iota(ids.begin(), ids.end(), 0u);
    std::vector<Neighbourhood> now(ids.size());
    search.compute(ids, now);
    for (std::uint32_t id = 0; id < known; ++id) {
      const PointRecord& record = scorer.record(id);
      const bool is_same =
          record.normal_L == now[id].normal_L && record.seen == now[id].seen && record.reach_N == now[id].reach_N;
      outcome.changed += is_same ? 0 : 1;
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

/// A flat patch of points in the plane x = 0, each with many returns in the middle of its voxel.
class SteadyPatch : public testing::Test {
 protected:
  SteadyPatch() : params_(steadyParams()), points_(params_, directionTable(36)) {
    for (int scan = 0; scan < 16; ++scan) {
      std::vector<Eigen::Vector3f> p;
      for (int y = -4; y <= 4; ++y) {
        for (int z = -4; z <= 4; ++z) {
          p.emplace_back(0, kVoxel_m * static_cast<float>(y), kVoxel_m * static_cast<float>(z));
        }
      }
      points_.addReturns(p, {&sensor_, 1});
    }
    scorer_.grow();
    for (std::uint32_t id = 0; id < points_.size(); ++id) all_.push_back(id);
    scorer_.refreshNeighbourhoods(all_);
    moved_points_.refreshed(all_);
    moved_points_.clear();
  }

  static FieldParams steadyParams() {
    FieldParams params = pointParams(kVoxel_m);
    params.tsdf.range_noise_m = kVoxel_m / 2;  // eight steps per voxel
    return params;
  }
  /// Adds a return beside the middle of the central voxel.
  void add(float offset_voxels) {
    const Eigen::Vector3f p(offset_voxels * kVoxel_m, 0, 0);
    moved_points_.note(points_.addReturns({&p, 1}, {&sensor_, 1}));
  }

  static constexpr float kVoxel_m = 0.0625f;
  Eigen::Vector3f sensor_ = {5, 0, 0};
  FieldParams params_;
  PointStore points_;
  std::unique_ptr<kernels::Backend> backend_ = kernels::makeCpuBackend();
  PointScorer scorer_{points_, params_, *backend_, noMap()};
  MovedPoints moved_points_{scorer_};
  std::vector<std::uint32_t> all_;
};

/// 17 returns with one 0.49 voxels off: the mean is at 0.03, less than half a step of 0.125.
TEST_F(SteadyPatch, AReturnWithinTheStepConcernsOnlyItsPoint) {
  add(0.49f);
  EXPECT_EQ(moved_points_.find(), std::vector<std::uint32_t>{points_.index().find({0, 0, 0})});
  EXPECT_TRUE(scorer_.refreshNeighbourhoods(all_).empty());
}

/// Three of them: at 0.077, over half a step. Every neighbourhood with that point moves, and the normals of some turn
/// by a step, so that their directions have to be ranked again.
TEST_F(SteadyPatch, AReturnThatCrossesAStepConcernsItsNeighbours) {
  std::vector<Neighbourhood> before(all_.size()), after(all_.size());
  const NeighbourhoodSearch search(points_, params_);
  search.compute(all_, before);
  for (int n = 0; n < 3; ++n) add(0.49f);
  search.compute(all_, after);
  std::vector<std::uint32_t> turned;
  for (const std::uint32_t id : all_) {
    if (before[id].normal_L != after[id].normal_L) turned.push_back(id);
  }
  EXPECT_GT(turned.size(), 3u);
  EXPECT_LT(turned.size(), all_.size() / 2);
  const std::vector<std::uint32_t> moved = moved_points_.find();
  EXPECT_TRUE(std::ranges::includes(moved, turned));
  EXPECT_LT(moved.size(), all_.size());
  EXPECT_EQ(scorer_.refreshNeighbourhoods(moved), turned);
}

}  // namespace
}  // namespace accessvdb::internal
