// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "change/box_walk.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

namespace accessvdb::internal {
namespace {

/// Against samples along the ray: every box with a sample well inside comes once, in order, with its part of the ray.
TEST(BoxWalk, MeetsTheBoxesOfDenseSamples) {
  std::mt19937 random(5);
  std::normal_distribution<double> gauss;
  std::uniform_real_distribution<double> place(-30, 30);
  for (int n = 0; n < 2000; ++n) {
    VoxelRay ray;
    double length = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      ray.from[axis] = n % 7 == 0 ? std::floor(place(random)) : place(random);  // also from faces
      ray.along[axis] = n % 5 == 0 && axis == 1 ? 0 : gauss(random);
      length += ray.along[axis] * ray.along[axis];
    }
    for (double& u : ray.along) u /= std::sqrt(length);
    const double begin = 0.1 * (n % 10), end = begin + 0.2 * (n % 200);
    const int edge = n % 3 == 0 ? 1 : 8;
    std::set<std::array<std::int32_t, 3>> met;
    double at = begin;
    forEachBox(ray, edge, begin, end, [&](const std::array<std::int32_t, 3>& box, double from, double to) {
      EXPECT_TRUE(met.insert(box).second);
      EXPECT_EQ(from, at);
      EXPECT_LT(from, to);
      at = to;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double middle = ray.from[axis] + 0.5 * (from + to) * ray.along[axis];
        EXPECT_NEAR(middle, edge * (box[axis] + 0.5), 0.5 * edge + 1e-9);  // rounding of 1e2 voxels
      }
    });
    EXPECT_EQ(at, std::max(begin, end));
    for (double s = begin; s < end; s += 0.01) {
      std::array<std::int32_t, 3> box;
      bool inside = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x = (ray.from[axis] + s * ray.along[axis]) / edge, down = std::floor(x);
        box[axis] = static_cast<std::int32_t>(down);
        inside = inside && x - down > 1e-6 && x - down < 1 - 1e-6;
      }
      ASSERT_TRUE(!inside || met.contains(box)) << n;
    }
  }
}

}  // namespace
}  // namespace accessvdb::internal
