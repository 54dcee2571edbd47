// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The walk over directions equals sorting all of them by (angle to the normal, index).
#include "hostdev/direction_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>

#include "tool/yaw_direction.h"
#include "unit/hostdev/occupancy_fixture.h"

namespace accessvdb::test {
namespace {

std::vector<int> sorted(const kernels::ApproachView& approach, const float* normal) {
  std::vector<std::pair<float, int>> inside;
  for (int d = 0; d < approach.num_directions; ++d) {
    const float x_part = approach.direction_xy[2 * d] * normal[0],
                y_part = approach.direction_xy[2 * d + 1] * normal[1];
    const float dot = x_part + y_part;
    if (dot >= approach.normal_cos_min) inside.emplace_back(-dot, d);
  }
  std::sort(inside.begin(), inside.end());
  std::vector<int> order;
  for (const auto& [dot, d] : inside) order.push_back(d);
  return order;
}

std::vector<int> walked(const kernels::ApproachView& approach, const float* normal) {
  std::vector<int> order;
  kernels::DirectionWalk walk(approach, normal);
  for (int d = walk.next(); d >= 0; d = walk.next()) order.push_back(d);
  return order;
}

class DirectionWalkOrder : public testing::TestWithParam<int> {};

TEST_P(DirectionWalkOrder, EqualsAFullSort) {
  const int num_directions = GetParam();
  std::mt19937_64 random(static_cast<std::uint64_t>(num_directions));
  ApproachFixture approach(num_directions, {});
  // The library's table is exactly symmetric under quarter turns, which makes true ties; both tables are tested.
  std::vector<float> symmetric;
  for (int d = 0; d < num_directions; ++d) {
    const auto yaw = internal::yawDirection(d, num_directions);
    symmetric.push_back(static_cast<float>(yaw.cos));
    symmetric.push_back(static_cast<float>(yaw.sin));
  }
  std::size_t directions = 0, ties = 0;
  for (int n = 0; n < 10000; ++n) {
    approach.view.direction_xy = n % 2 == 0 ? approach.xy.data() : symmetric.data();
    // Every fourth normal is exactly at a direction or exactly between two; some lean, up to out of every cone.
    const double yaw =
        n % 4 == 0 ? 3.141592653589793 * below(random, 2 * num_directions) / num_directions : between(random, 0, 6.3);
    const double lean = n % 3 == 0 ? 0 : between(random, -1.5, 1.5);
    Eigen::Vector3f normal(static_cast<float>(std::cos(yaw) * std::cos(lean)),
                           static_cast<float>(std::sin(yaw) * std::cos(lean)), static_cast<float>(std::sin(lean)));
    if (n % 8 == 4) normal = {n % 16 == 4 ? 1.0f : -1.0f, 0, 0};
    if (n % 8 == 5) normal = {std::sqrt(0.5f), n % 16 == 5 ? std::sqrt(0.5f) : -std::sqrt(0.5f), 0};
    const auto expected = sorted(approach.view, normal.data());
    ASSERT_EQ(walked(approach.view, normal.data()), expected) << "normal " << normal.transpose();
    directions += expected.size();
    for (std::size_t i = 1; i < expected.size(); ++i) {
      ties += kernels::cosToNormal(approach.view, expected[i], normal.data()) ==
                      kernels::cosToNormal(approach.view, expected[i - 1], normal.data())
                  ? 1
                  : 0;
    }
  }
  EXPECT_GT(directions, 1000u);
  if (num_directions % 4 == 0) {
    EXPECT_GT(ties, 100u);
  }
}

/// Normals of all kinds: level, steep, straight up, and so flat that their yaw is rounding; exactly at directions or
/// not.
Eigen::Vector3f anyNormal(std::mt19937_64& random, int num_directions, int n) {
  if (n % 16 == 5) return {0, 0, n % 32 == 5 ? 1.0f : -1.0f};
  const double yaw =
      n % 4 == 0 ? 3.141592653589793 * below(random, 2 * num_directions) / num_directions : between(random, -3.2, 6.3);
  const double lean = n % 3 == 0 ? 0 : n % 7 == 0 ? 1.5707 + between(random, -2e-3, 2e-3) : between(random, -1.5, 1.5);
  return {static_cast<float>(std::cos(yaw) * std::cos(lean)), static_cast<float>(std::sin(yaw) * std::cos(lean)),
          static_cast<float>(std::sin(lean))};
}

/// None is missing that has that cosine, and of those beside the arc there are few.
TEST_P(DirectionWalkOrder, AroundANormalIsEveryDirectionOfACosine) {
  const int num_directions = GetParam();
  std::mt19937_64 random(static_cast<std::uint64_t>(num_directions) + 1);
  const ApproachFixture approach(num_directions, {});
  std::size_t inside = 0, outside = 0;
  for (int n = 0; n < 20000; ++n) {
    const Eigen::Vector3f normal = anyNormal(random, num_directions, n);
    const float of_one = kernels::cosToNormal(approach.view, below(random, num_directions), normal.data());
    const float least = n % 2 == 0 ? of_one : static_cast<float>(between(random, -1.1, 1.1));
    const kernels::DirectionMask around = kernels::aroundNormal(approach.view, normal.data(), least);
    int has = 0, taken = 0;
    for (int d = 0; d < num_directions; ++d) {
      const bool wanted = kernels::cosToNormal(approach.view, d, normal.data()) >= least;
      ASSERT_TRUE(!wanted || around.test(d)) << "direction " << d << ", normal " << normal.transpose() << ", " << least;
      has += wanted ? 1 : 0;
    }
    kernels::forEachDirection(around, [&](int d) {
      ASSERT_LT(d, num_directions);
      ++taken;
    });
    inside += static_cast<std::size_t>(has);
    outside += static_cast<std::size_t>(num_directions - taken);
    if (normal.head<2>().norm() > 0.1f && has > 0 && has + 10 < num_directions) {
      ASSERT_LE(taken, has + 5);
    }
  }
  EXPECT_GT(inside, 1000u);
  if (num_directions > 16) {
    EXPECT_GT(outside, 1000u);
  }
}

/// Directions of any kind, and yaws that do not count on being yaws, in the same order.
TEST_P(DirectionWalkOrder, OfAnyKindEqualsAFullSort) {
  const int num_directions = GetParam();
  std::mt19937_64 random(static_cast<std::uint64_t>(num_directions));
  ApproachFixture yaws(num_directions, {}), scattered(num_directions, {});
  scattered.scatter(random, {});
  std::vector<float> level;
  for (int d = 0; d < num_directions; ++d) {
    const auto yaw = internal::yawDirection(d, num_directions);
    for (const double x : {yaw.cos, yaw.sin, 0.0}) level.push_back(static_cast<float>(x));
    yaws.xy[static_cast<std::size_t>(2 * d)] = static_cast<float>(yaw.cos);
    yaws.xy[static_cast<std::size_t>(2 * d + 1)] = static_cast<float>(yaw.sin);
  }
  kernels::ApproachView any = yaws.view;
  any.direction_xy = nullptr;
  any.axes_xyz = level.data();
  const auto sortedWalk = [](const kernels::ApproachView& approach, const float* normal) {
    std::vector<int> order;
    kernels::SortedWalk walk(approach, normal);
    for (int d = walk.next(); d >= 0; d = walk.next()) order.push_back(d);
    return order;
  };
  std::size_t directions = 0;
  for (int n = 0; n < 10000; ++n) {
    const double yaw = 3.141592653589793 * below(random, 2 * num_directions) / num_directions;
    const double lean = n % 3 == 0 ? 0 : between(random, -1.6, 1.6);
    Eigen::Vector3f normal(static_cast<float>(std::cos(yaw) * std::cos(lean)),
                           static_cast<float>(std::sin(yaw) * std::cos(lean)), static_cast<float>(std::sin(lean)));
    if (n % 16 == 5) normal = {0, 0, n % 32 == 5 ? 1.0f : -1.0f};
    ASSERT_EQ(sortedWalk(any, normal.data()), walked(yaws.view, normal.data())) << "normal " << normal.transpose();
    std::vector<std::pair<float, int>> inside;
    for (int d = 0; d < num_directions; ++d) {
      const float* axis = scattered.axes.data() + 3 * d;
      const float level_part = axis[0] * normal.x() + axis[1] * normal.y();
      const float dot = level_part + axis[2] * normal.z();
      if (dot >= scattered.view.normal_cos_min) inside.emplace_back(-dot, d);
    }
    std::sort(inside.begin(), inside.end());
    std::vector<int> expected;
    for (const auto& [dot, d] : inside) expected.push_back(d);
    ASSERT_EQ(sortedWalk(scattered.view, normal.data()), expected) << "normal " << normal.transpose();
    directions += expected.size();
  }
  EXPECT_GT(directions, 1000u);
}

INSTANTIATE_TEST_SUITE_P(Counts, DirectionWalkOrder, testing::Values(4, 5, 17, 36, 180, 256));

TEST(DirectionWalk, ConesOfAllWidths) {
  std::mt19937_64 random(3);
  for (int n = 0; n < 500; ++n) {
    const ApproachFixture approach(4 + below(random, 253), {}, between(random, 0.01, 1.5707963));
    const double yaw = between(random, 0, 6.3);
    const float normal[3] = {static_cast<float>(std::cos(yaw)), static_cast<float>(std::sin(yaw)), 0};
    ASSERT_EQ(walked(approach.view, normal), sorted(approach.view, normal));
  }
}

TEST(DirectionWalk, StraightUpHasNoDirection) {
  const ApproachFixture approach(180, {});
  const float up[3] = {0, 0, 1};
  EXPECT_TRUE(walked(approach.view, up).empty());
}

}  // namespace
}  // namespace accessvdb::test
