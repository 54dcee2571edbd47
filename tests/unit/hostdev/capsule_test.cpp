// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The walk along a capsule: visits every leaf with a touched voxel, none twice, anywhere in the index space.
#include "hostdev/capsule.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <tuple>

namespace accessvdb::kernels {
namespace {

using Leaf = std::tuple<int, int, int>;

struct Case {
  double a[3], b[3], radius;
};

/// Uniform in [low, high] from raw bits: the same on every machine.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
}

double distanceToAxis(const Case& c, double x, double y, double z) {
  double length2 = 0, dot = 0, r[3] = {x - c.a[0], y - c.a[1], z - c.a[2]};
  for (int axis = 0; axis < 3; ++axis) {
    length2 += (c.b[axis] - c.a[axis]) * (c.b[axis] - c.a[axis]);
    dot += r[axis] * (c.b[axis] - c.a[axis]);
  }
  const double t = length2 > 0 ? std::min(1.0, std::max(0.0, dot / length2)) : 0.0;
  double distance2 = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double e = r[axis] - t * (c.b[axis] - c.a[axis]);
    distance2 += e * e;
  }
  return std::sqrt(distance2);
}

/// Checks a case at voxel size 1.
void check(const Case& c) {
  SCOPED_TRACE(testing::Message() << c.a[0] << " " << c.a[1] << " " << c.a[2] << " to " << c.b[0] << " " << c.b[1]
                                  << " " << c.b[2] << " radius " << c.radius);
  Capsule capsule;
  ASSERT_TRUE(makeCapsule(c.a, c.b, c.radius, 1.0f, capsule));
  std::set<Leaf> visited;
  Coord origin;
  for (CapsuleLeaves leaves(capsule); leaves.next(origin);) {
    ASSERT_EQ((origin[0] | origin[1] | origin[2]) & 7, 0);
    ASSERT_TRUE(visited.insert({origin[0], origin[1], origin[2]}).second) << "twice";
  }
  const double reach = c.radius + std::sqrt(3.0) / 2;
  std::set<Leaf> needed;
  int low[3], high[3];
  for (int axis = 0; axis < 3; ++axis) {
    low[axis] = int(std::floor(std::min(c.a[axis], c.b[axis]) - reach));
    high[axis] = int(std::ceil(std::max(c.a[axis], c.b[axis]) + reach));
  }
  for (int x = low[0]; x <= high[0]; ++x) {
    for (int y = low[1]; y <= high[1]; ++y) {
      for (int z = low[2]; z <= high[2]; ++z) {
        const double distance = distanceToAxis(c, x, y, z);
        if (distance <= reach) needed.insert({x & ~7, y & ~7, z & ~7});
        if (distance > reach + 1) continue;
        const AxisPoint nearest = nearestOnAxis(capsule, float(x - capsule.anchor[0]), float(y - capsule.anchor[1]),
                                                float(z - capsule.anchor[2]));
        ASSERT_NEAR(std::sqrt(nearest.distance2), distance, 2e-3);
      }
    }
  }
  for (const Leaf& leaf : needed) ASSERT_TRUE(visited.count(leaf) == 1);
  ASSERT_LE(visited.size(), 4 * needed.size() + 27);  // but not everything
}

TEST(CapsuleLeaves, CoverWhatIsTouched) {
  std::mt19937_64 random(5);
  for (int n = 0; n < 200; ++n) {
    Case c;
    const double far = n % 3 == 0 ? 900000 : n % 3 == 1 ? 50 : 5000;  // also the negative octants
    for (int axis = 0; axis < 3; ++axis) {
      c.a[axis] = uniform(random, -far, far);
      c.b[axis] = c.a[axis] + uniform(random, -60, 60);
    }
    c.radius = n % 4 == 0 ? 0 : uniform(random, 0, 9);
    if (n % 10 == 1) c.b[n % 3] = c.a[n % 3];
    if (n % 10 == 2) std::copy(c.a, c.a + 3, c.b);  // a ball
    check(c);
    if (testing::Test::HasFatalFailure()) return;
  }
  check({{0, 0, 0}, {100, 0, 0}, 0});
  check({{-4, -4, -4}, {-4, -4, 44}, 0.5});
  check({{8, 8, 8}, {8, 8, 8}, 0});
}

TEST(FirstWithin, IsTheFirstParameter) {
  std::mt19937_64 random(6);
  int inside = 0, later = 0;
  for (int n = 0; n < 2000; ++n) {
    Case c;
    for (int axis = 0; axis < 3; ++axis) {
      c.a[axis] = uniform(random, -500, 500);
      c.b[axis] = c.a[axis] + uniform(random, -1, 1) * (n % 2 == 0 ? 20 : 4000);
    }
    Capsule capsule;
    ASSERT_TRUE(makeCapsule(c.a, c.b, 0, 1.0f, capsule));
    // A position near the axis, and its distance.
    const double t0 = uniform(random, -0.1, 1.1);
    double x[3];
    for (int axis = 0; axis < 3; ++axis) {
      x[axis] = c.a[axis] + t0 * (c.b[axis] - c.a[axis]) + uniform(random, -3, 3);
    }
    const double nearest = distanceToAxis(c, x[0], x[1], x[2]), reach = nearest + uniform(random, 0.05, 4);
    const float t = firstWithin(capsule, float(x[0] - capsule.anchor[0]), float(x[1] - capsule.anchor[1]),
                                float(x[2] - capsule.anchor[2]), float(reach));
    const auto distanceAt = [&](double at) {
      double sum = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const double e = c.a[axis] + at * (c.b[axis] - c.a[axis]) - x[axis];
        sum += e * e;
      }
      return std::sqrt(sum);
    };
    ASSERT_GE(t, 0);
    ASSERT_LE(t, 1);
    constexpr double kVoxels = 5e-3;  // float32 on an axis of up to 7 000 voxels
    ASSERT_LE(distanceAt(t), reach + kVoxels) << n;
    if (t > 0) {
      ASSERT_GE(distanceAt(t), reach - kVoxels) << n;  // any earlier is too far
    }
    ++(t > 0 ? later : inside);
  }
  EXPECT_GT(inside, 50);
  EXPECT_GT(later, 50);
}

TEST(MakeCapsule, RefusesWhatCannotBeWalked) {
  Capsule capsule;
  const double a[3] = {0, 0, 0}, b[3] = {10, 0, 0};
  EXPECT_TRUE(hasVoxel(a, 1));
  EXPECT_TRUE(makeCapsule(a, b, 0, 1, capsule));
  EXPECT_TRUE(makeCapsule(a, a, 0, 1, capsule));
  EXPECT_FALSE(makeCapsule(a, b, -1e-9, 1, capsule));
  EXPECT_FALSE(makeCapsule(a, b, NAN, 1, capsule));
  EXPECT_FALSE(makeCapsule(a, b, INFINITY, 1, capsule));
  for (const double bad : {double(NAN), double(INFINITY), -double(INFINITY), 1.1e6, -1.1e6}) {
    for (int axis = 0; axis < 3; ++axis) {
      double c[3] = {0, 0, 0};
      c[axis] = bad;
      EXPECT_FALSE(hasVoxel(c, 1));
      EXPECT_FALSE(makeCapsule(a, c, 1, 1, capsule));
      EXPECT_FALSE(makeCapsule(c, a, 1, 1, capsule));
    }
  }
  const double far[3] = {33000, 0, 0}, less_far[3] = {32000, 0, 0};
  EXPECT_FALSE(makeCapsule(a, far, 1, 1, capsule));
  EXPECT_TRUE(makeCapsule(a, less_far, 1, 1, capsule));
  EXPECT_FALSE(makeCapsule(a, less_far, 1000, 1, capsule));
  EXPECT_FALSE(makeCapsule(a, b, 1000, 1, capsule));
}

}  // namespace
}  // namespace accessvdb::kernels
