// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <vector>

#include "update/device_points.h"

namespace accessvdb::internal {
namespace {

TEST(PointsOnDevice, AtMost64BytesAPointUpTo192Directions) {
  EXPECT_LE(PointsOnDevice::bytesPerPoint(3), 64u);
  EXPECT_EQ(PointsOnDevice::bytesPerPoint(4), PointsOnDevice::bytesPerPoint(3) + 8);
  // The reported size is the allocated one.
  const auto backend = kernels::makeCpuBackend();
  PointsOnDevice points(*backend, 3);
  points.grow(1000);
  EXPECT_EQ(points.bytes() % PointsOnDevice::bytesPerPoint(3), 0u);
  EXPECT_GE(points.bytes(), 1000 * PointsOnDevice::bytesPerPoint(3));
}

TEST(PointsOnDevice, GrowthKeepsValuesAndNewPointsAreUnscored) {
  const auto backend = kernels::makeCpuBackend();
  PointsOnDevice points(*backend, 2);
  std::uint32_t size = 0;
  const auto expectFresh = [](const kernels::PointStateView& view, std::uint32_t id) {
    ASSERT_EQ(view.score[id], kNoScore);
    ASSERT_EQ(view.direction[id], kNoDirection);
    ASSERT_EQ(view.weight[id], 0);
    ASSERT_EQ(view.stability[id], 1.0f);
    ASSERT_EQ(view.label[id], PointLabel::Unscored);
    ASSERT_EQ(view.reason[id], PointReason::Confidence);
  };
  for (const std::uint32_t next : {10u, 11u, 70000u, 200000u, 200000u}) {
    points.grow(next);
    ASSERT_EQ(points.size(), next);
    const kernels::PointStateView view = points.view();
    for (std::uint32_t id = 0; id < size; ++id) {
      ASSERT_EQ(view.position_L[3 * std::size_t{id} + 2], static_cast<float>(id));
      ASSERT_EQ(view.normal_L[3 * std::size_t{id}], static_cast<float>(id) + 0.5f);
      ASSERT_EQ(view.seen[2 * std::size_t{id} + 1], id * 3ull);
      ASSERT_EQ(view.score[id], id % 1000);
      ASSERT_EQ(view.direction[id], id % 180);
      ASSERT_EQ(view.weight[id], id % 77);
      ASSERT_EQ(view.stability[id], 1 / (1 + static_cast<float>(id)));
      ASSERT_EQ(view.label[id], PointLabel::Blocked);
      ASSERT_EQ(view.reason[id], PointReason::Arm);
    }
    for (std::uint32_t id = size; id < next; ++id) expectFresh(view, id);
    for (std::uint32_t id = size; id < next; ++id) {
      view.position_L[3 * std::size_t{id} + 2] = static_cast<float>(id);
      view.normal_L[3 * std::size_t{id}] = static_cast<float>(id) + 0.5f;
      view.seen[2 * std::size_t{id} + 1] = id * 3ull;
      view.score[id] = static_cast<std::uint16_t>(id % 1000);
      view.direction[id] = static_cast<std::uint16_t>(id % 180);
      view.weight[id] = static_cast<std::uint16_t>(id % 77);
      view.stability[id] = 1 / (1 + static_cast<float>(id));
      view.label[id] = PointLabel::Blocked;
      view.reason[id] = PointReason::Arm;
    }
    size = next;
  }
  points.grow(5);  // never shrinks
  EXPECT_EQ(points.size(), 200000u);
}

}  // namespace
}  // namespace accessvdb::internal
