// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points lie where the surface is, against the rule in its own words.
#include "hostdev/surface_choice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>
#include <vector>

namespace accessvdb {
namespace {

using kernels::CompetingPoint;
using kernels::SurfaceChoice;
using Column = std::vector<CompetingPoint>;

bool isOnSurface(const Column& column, std::size_t n, std::int32_t window) {
  return kernels::isOnSurface(column[n], window, [&](const auto& visit) {
    for (const CompetingPoint& point : column) visit(point);
  });
}

/// The point nearest to the mean height of the returns around the n-th, in doubles, which
/// hold these whole numbers; of equals the lower, then the one
/// with the lower voxel.
std::size_t nearestToMean(const Column& column, std::size_t n, std::int32_t window) {
  double returns = 0, sum = 0;
  for (const CompetingPoint& point : column) {
    if (std::abs(std::int64_t{point.height} - column[n].height) > window) continue;
    const double count = std::min(point.returns, 65535u);
    returns += count;
    sum += count * point.height;
  }
  const auto off = [&](const CompetingPoint& point) { return std::abs(returns * point.height - sum); };
  const auto before = [&](const CompetingPoint& a, const CompetingPoint& b) {
    if (off(a) != off(b)) return off(a) < off(b);
    if (a.height != b.height) return a.height < b.height;
    return std::lexicographical_compare(a.voxel, a.voxel + 3, b.voxel, b.voxel + 3);
  };
  return static_cast<std::size_t>(std::min_element(column.begin(), column.end(), before) - column.begin());
}

Column randomColumn(std::mt19937_64& random) {
  const int points = 1 + static_cast<int>(random() % 40), spread = std::array{3, 200, 40'000}[random() % 3];
  const std::uint32_t most = std::array{1u, 9u, 200'000u}[random() % 3];
  std::set<std::array<std::int32_t, 3>> voxels;
  Column column;
  while (static_cast<int>(column.size()) < points) {
    CompetingPoint point;
    point.height = static_cast<std::int32_t>(random() % static_cast<unsigned>(2 * spread)) - spread;
    point.returns = 1 + static_cast<std::uint32_t>(random()) % most;
    for (std::int32_t& i : point.voxel) i = static_cast<std::int32_t>(random() % 4) - 2;
    if (voxels.insert({point.voxel[0], point.voxel[1], point.voxel[2]}).second) column.push_back(point);
  }
  return column;
}

TEST(SurfaceChoice, TakesThePointNearestToTheMeanAroundIt) {
  std::mt19937_64 random(1);
  std::size_t chosen = 0, all = 0, ties = 0;
  for (int n = 0; n < 4000; ++n) {
    const Column column = randomColumn(random);
    const auto window = static_cast<std::int32_t>(random() % std::array{1u, 5u, 300u, 60'000u}[random() % 4]);
    for (std::size_t k = 0; k < column.size(); ++k) {
      const std::size_t nearest = nearestToMean(column, k, window);
      ASSERT_EQ(isOnSurface(column, k, window), nearest == k) << n << " " << k;
      ties += nearest != k && column[nearest].height == column[k].height ? 1 : 0;
      chosen += nearest == k ? 1 : 0;
    }
    all += column.size();
  }
  EXPECT_GT(chosen, all / 20);
  EXPECT_LT(chosen, all / 2);
  EXPECT_GT(ties, 500u);
}

/// No column is left without a point, and from each point steps within the window lead to one that is chosen.
TEST(SurfaceChoice, LeavesNoHole) {
  std::mt19937_64 random(2);
  std::size_t steps = 0;
  for (int n = 0; n < 4000; ++n) {
    const Column column = randomColumn(random);
    const auto window = static_cast<std::int32_t>(random() % std::array{1u, 5u, 300u, 60'000u}[random() % 4]);
    for (std::size_t k = 0; k < column.size(); ++k) {
      std::size_t at = k, taken = 0;
      while (!isOnSurface(column, at, window)) {
        const std::size_t next = nearestToMean(column, at, window);
        ASSERT_LE(std::abs(column[next].height - column[at].height), window);
        at = next;
        ASSERT_LE(++taken, column.size()) << "a circle";
      }
      steps += taken;
    }
  }
  EXPECT_GT(steps, 10'000u);
}

TEST(SurfaceChoice, DoesNotDependOnTheOrder) {
  std::mt19937_64 random(3);
  for (int n = 0; n < 300; ++n) {
    Column column = randomColumn(random);
    const CompetingPoint own = column.front();
    const bool is_on_surface = isOnSurface(column, 0, 200);
    std::ranges::shuffle(column, random);
    const auto at = std::ranges::find_if(
        column, [&](const CompetingPoint& point) { return std::equal(point.voxel, point.voxel + 3, own.voxel); });
    ASSERT_EQ(isOnSurface(column, static_cast<std::size_t>(at - column.begin()), 200), is_on_surface);
  }
}

/// As a warp does it: each lane adds up some points, and then compares them with what all of them add up to.
TEST(SurfaceChoice, CanBeMadeInParts) {
  std::mt19937_64 random(5);
  for (int n = 0; n < 300; ++n) {
    const Column column = randomColumn(random);
    kernels::WindowReturns parts[3] = {{column.front(), 200}, {column.front(), 200}, {column.front(), 200}};
    for (std::size_t k = 0; k < column.size(); ++k) parts[k % 3].add(column[k]);
    kernels::WindowReturns all = {column.front(), 200};
    for (const kernels::WindowReturns& part : parts) all.returns += part.returns, all.moment += part.moment;
    const bool nearest = std::ranges::none_of(column, [&](const auto& point) { return all.isNearer(point); });
    ASSERT_EQ(nearest, nearestToMean(column, 0, 200) == 0);
  }
}

/// As many returns as a voxel can have, as far apart as a window can be.
TEST(SurfaceChoice, SumsDoNotOverflow) {
  constexpr std::int32_t kFarthest = 100 * kernels::kHeightsPerVoxel;
  Column column;
  for (int n = 0; n < 200'000; ++n) {
    column.push_back({n % 2 == 0 ? 1'000'000'000 : 1'000'000'000 + kFarthest, ~0u, {n, 0, 0}});
  }
  column.push_back({1'000'000'000 + kFarthest / 2, 1, {0, 0, 0}});
  EXPECT_TRUE(isOnSurface(column, column.size() - 1, kFarthest));
  EXPECT_FALSE(isOnSurface(column, 0, kFarthest));
  EXPECT_FALSE(isOnSurface(column, 1, kFarthest));
}

TEST(SurfaceChoice, CellsTileTheAxisOnBothSidesOfZero) {
  for (const int edge : {1, 2, 3, 5, 8}) {
    const SurfaceChoice choice = SurfaceChoice::of(0.01, 0.01 * edge, 0.04);
    EXPECT_EQ(choice.edge, edge);
    for (std::int32_t i = -40; i < 40; ++i) {
      const std::int32_t low = choice.cellOf(i);
      EXPECT_EQ(low % edge, 0);
      EXPECT_LE(low, i);
      EXPECT_LT(i, low + edge);
    }
  }
  EXPECT_FALSE(SurfaceChoice().isMade());
  EXPECT_EQ(SurfaceChoice::of(0.01, 0.001, 0.04).edge, 1);  // a cell is a voxel or more
}

/// Two voxels of which one mean may lie within the window of the other are in each other's box.
TEST(SurfaceChoice, BoxHoldsTheWindow) {
  std::mt19937_64 random(4);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  for (int n = 0; n < 20'000; ++n) {
    const double v = std::array{0.001, 0.02, 0.5}[random() % 3];
    const SurfaceChoice choice = SurfaceChoice::of(v, uniform(0, 4) * v, uniform(0, 10) * v);
    const std::int32_t a = static_cast<std::int32_t>(random() % 2000) - 1000;
    const std::int32_t b = a + static_cast<std::int32_t>(random() % 30) - 15;
    const auto mean = [&](std::int32_t i) { return static_cast<float>((i + uniform(-0.75, 0.75)) * v); };
    if (std::abs(choice.heightOf(mean(a)) - choice.heightOf(mean(b))) > choice.window) continue;
    const std::int32_t voxel[3] = {5, a, -7};
    const kernels::CompetingVoxels box(choice, voxel, 1);
    ASSERT_TRUE(box.low[1] <= b && b <= box.high[1]);
    ASSERT_TRUE(box.low[0] <= 5 && 5 <= box.high[0] && box.high[0] - box.low[0] == choice.edge - 1);
    const std::int32_t same_cell[3] = {box.low[0], b, box.high[2]}, next_cell[3] = {box.high[0] + 1, b, -7};
    ASSERT_TRUE(box.hold(voxel) && box.hold(same_cell));
    ASSERT_FALSE(box.hold(next_cell));
  }
}

/// A point competes as far as the farthest corner of its box, or less.
TEST(SurfaceChoice, ReachesTheCornersOfTheBox) {
  const SurfaceChoice choice = SurfaceChoice::of(0.01, 0.03, 0.05);
  const std::int32_t voxel[3] = {0, 0, 0};
  const kernels::CompetingVoxels box(choice, voxel, 2);
  EXPECT_GE(choice.reachVoxels(), std::hypot(box.high[0], box.high[1], box.high[2]));
  EXPECT_LT(choice.reachVoxels(), 12);
  EXPECT_EQ(SurfaceChoice().reachVoxels(), 0);
}

TEST(SurfaceChoice, TakesTheSteepestAxis) {
  const auto axis = [](float x, float y, float z) {
    const float normal[3] = {x, y, z};
    return kernels::mainAxis(normal);
  };
  EXPECT_EQ(axis(0.1f, -0.9f, 0.2f), 1);
  EXPECT_EQ(axis(0.1f, -0.2f, -0.9f), 2);
  EXPECT_EQ(axis(-0.7f, 0.7f, 0.1f), 0);  // of equals the first
  EXPECT_EQ(axis(0.1f, 0.7f, -0.7f), 1);
}

/// What asks for a normal finds none, and no other normal looks like this.
TEST(SurfaceChoice, BesideTheSurfaceThereIsNoNormal) {
  for (int axis = 0; axis < 3; ++axis) {
    float normal[3] = {1, 2, 3};
    kernels::writeBesideSurface(axis, normal);
    EXPECT_TRUE(normal[0] == 0 && normal[1] == 0 && normal[2] == 0);
    EXPECT_EQ(kernels::besideSurfaceAxis(normal), axis);
    EXPECT_EQ(kernels::competingAxis(normal), axis);
  }
  const float none[3] = {0, 0, 0}, level[3] = {-0.0f, -0.0f, -1};
  EXPECT_EQ(kernels::besideSurfaceAxis(none), -1);
  EXPECT_EQ(kernels::besideSurfaceAxis(level), -1);
  EXPECT_EQ(kernels::competingAxis(none), -1);
  EXPECT_EQ(kernels::competingAxis(level), 2);
}

}  // namespace
}  // namespace accessvdb
