// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Of a wide set, a point that is seen from another side counts as changed although its normal stays.
#include <gtest/gtest.h>

#include <numeric>
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
  PointStore points(params, {}, axes);
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

}  // namespace
}  // namespace accessvdb::internal
