// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points a refresh of neighbourhoods calls changed, also with memory of an earlier refresh; and of a wide set
/// those that are seen from another side although their normals stay.
#include <gtest/gtest.h>

#include <numeric>
#include <utility>
#include <vector>

#include "launch/backend.h"
#include "unit/points/random_points.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {
namespace {

TEST(WideRefresh, NoticesNewViewsAlone) {
  test::Random random(5);
  std::vector<float> axes;
  while (axes.size() < 3 * 400) {
    for (const float x : random.point(1).normalized()) axes.push_back(x);
  }
  const FieldParams params = test::pointParams(0.05);
  PointStore points(params, {{}, axes});
  std::vector<Eigen::Vector3f> p;
  for (int x = 0; x < 20; ++x) {
    for (int y = 0; y < 20; ++y) p.emplace_back(0.05f * static_cast<float>(x), 0.05f * static_cast<float>(y), 0.0f);
  }
  const auto seenFrom = [&](const Eigen::Vector3f& q) { points.addReturns(p, std::vector<Eigen::Vector3f>{q}); };
  const auto backend = kernels::makeCpuBackend();
  PointScorer scorer(points, params, *backend, {});
  std::vector<std::uint32_t> ids(p.size());
  std::iota(ids.begin(), ids.end(), 0u);
  seenFrom({0, 0, 2});
  ASSERT_EQ(points.size(), p.size());
  scorer.grow();
  EXPECT_EQ(scorer.refreshNeighbourhoods(ids).ids, ids);
  const Eigen::Vector3f normal_L = scorer.record(210).normal_L;
  EXPECT_TRUE(scorer.refreshNeighbourhoods(ids).ids.empty());
  seenFrom({2, 0, 1});
  EXPECT_EQ(scorer.refreshNeighbourhoods(ids).ids.size(), ids.size());
  EXPECT_EQ(scorer.record(210).normal_L, normal_L);
  EXPECT_TRUE(scorer.refreshNeighbourhoods(ids).ids.empty());
}

/// A few points at a time, with memory that is used again.
TEST(Refresh, LeavesNothingOfTheLastOneBehind) {
  test::Random random(6);
  const FieldParams params = test::pointParams(0.05);
  PointStore points(params, test::directionTable(params.approach.num_directions));
  std::vector<Eigen::Vector3f> p;
  for (int n = 0; n < 3000; ++n) p.push_back(random.point(1.5f));
  points.addReturns(p, std::vector<Eigen::Vector3f>{{0, 0, 4}});
  const auto backend = kernels::makeCpuBackend();
  PointScorer scorer(points, params, *backend, {});
  scorer.grow();
  PointScorer::Changed changed;
  std::vector<std::uint32_t> ids;
  for (const auto& [part, is_new] : {std::pair{0u, true}, {1u, true}, {0u, false}, {2u, true}}) {
    ids.clear();
    for (std::uint32_t id = part; id < points.size(); id += 3) ids.push_back(id);
    ASSERT_TRUE(scorer.keepsMemoryFor(ids.size()));
    changed = scorer.refreshNeighbourhoods(ids, std::move(changed));
    EXPECT_EQ(changed.ids, is_new ? ids : std::vector<std::uint32_t>{});
    ASSERT_EQ(changed.before.size(), changed.ids.size());
    for (const kernels::PointDirections& before : changed.before) EXPECT_FALSE(before.hasNormal());
  }
  PointScorer at_once(points, params, *backend, {});
  at_once.grow();
  ids.resize(points.size());
  std::iota(ids.begin(), ids.end(), 0u);
  EXPECT_FALSE(at_once.keepsMemoryFor(ids.size()));
  EXPECT_EQ(at_once.refreshNeighbourhoods(ids).ids.size(), ids.size());
  for (const std::uint32_t id : ids) {
    ASSERT_EQ(scorer.record(id).normal_L, at_once.record(id).normal_L);
    ASSERT_EQ(scorer.record(id).reach_m, at_once.record(id).reach_m);
    ASSERT_EQ(scorer.record(id).seen, at_once.record(id).seen);
  }
}

}  // namespace
}  // namespace accessvdb::internal
