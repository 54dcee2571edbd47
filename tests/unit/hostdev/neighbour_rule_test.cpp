// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The steps of means and normals, against plain arithmetic in higher precision and against search.
#include "hostdev/neighbour_rule.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "support/normal_grid.h"

namespace accessvdb::kernels {
namespace {

/// floor(a / b) by counting up from below; b > 0.
std::int64_t floorByCounting(std::int64_t a, std::int64_t b) {
  auto quotient = static_cast<std::int64_t>(std::floor(static_cast<long double>(a) / static_cast<long double>(b))) - 2;
  while ((quotient + 1) * b <= a) ++quotient;
  return quotient;
}

TEST(MeanSteps, AreTheNearestHalvesUp) {
  std::mt19937_64 engine(1);
  const auto below = [&](std::uint64_t n) { return static_cast<std::int64_t>(engine() % n); };
  int halves = 0;
  for (int n = 0; n < 20000; ++n) {
    const int steps = 1 << below(6);
    const std::int64_t returns = 1 + below(n % 3 == 0 ? 8 : 100000);
    std::int64_t offsets = 0;
    if (n % 2 == 0) {
      offsets = below(static_cast<std::uint64_t>(returns << 21)) - (returns << 20);  // up to a voxel either way
    } else {  // exactly half way between two steps, or one unit beside it
      offsets = (2 * below(static_cast<std::uint64_t>(2 * steps)) - 2 * steps + 1) * (returns << 20) / (2 * steps) +
                below(3) - 1;
    }
    const auto voxel = static_cast<std::int32_t>(below(20001) - 10000);
    halves += 2 * steps * offsets % (returns << 20) == 0 && steps * offsets % (returns << 20) != 0 ? 1 : 0;
    // mean in steps + 1/2 = (2 steps offsets + returns 2^20) / (2 returns 2^20)
    const std::int64_t whole = floorByCounting(2 * steps * offsets + (returns << 20), returns << 21);
    const float found = meanInSteps(voxel, {offsets, static_cast<std::uint32_t>(returns)}, steps);
    ASSERT_EQ(found, static_cast<float>(voxel * steps + whole)) << steps << " " << returns << " " << offsets;
  }
  EXPECT_GT(halves, 1000);
}

/// The largest sums that a store can hold do not overflow.
TEST(MeanSteps, OfTheMostReturns) {
  const std::uint32_t returns = std::numeric_limits<std::uint32_t>::max();
  const std::int64_t offsets = std::int64_t{returns} << 20;  // all a whole voxel off
  for (const int steps : {2, 4, 8, 16, 32}) {
    EXPECT_EQ(meanInSteps(7, {offsets, returns}, steps), static_cast<float>(8 * steps));
    EXPECT_EQ(meanInSteps(7, {-offsets, returns}, steps), static_cast<float>(6 * steps));
  }
}

/// A return moves the mean of a voxel with many by less than a step, and mostly nothing is to be seen of it.
TEST(MeanSteps, HoldStillUnderManyReturns) {
  std::mt19937_64 engine(2);
  AxisSum sum = {0, 0};
  int moves = 0;
  float before = 0;
  for (int n = 0; n < 2000; ++n) {
    sum.offsets += static_cast<std::int64_t>(engine() >> 44) - (1 << 19);  // uniform in the voxel
    ++sum.returns;
    const float now = meanInSteps(0, sum, 8);
    if (n >= 20) moves += now != before ? 1 : 0;
    before = now;
  }
  EXPECT_LT(moves, 200);
}

TEST(NeighbourSteps, AreNeverFinerWhereThereIsMoreNoise) {
  NeighbourSteps before = neighbourSteps(0);
  for (double noise_voxels = 0; noise_voxels < 4; noise_voxels += 0.01) {
    const NeighbourSteps now = neighbourSteps(noise_voxels);
    EXPECT_LE(now.mean, before.mean);
    EXPECT_LE(now.normal, before.normal);
    EXPECT_EQ(now.mean & (now.mean - 1), 0);  // voxels_per_unit is exact
    EXPECT_LE(1.0 / now.mean, std::max(1.0 / 32, noise_voxels / 4 + 1e-12));
    before = now;
  }
}

TEST(NormalSteps, AreTheNearestOnTheCube) {
  std::mt19937_64 engine(3);
  std::normal_distribution<double> gauss;
  int compared = 0;
  for (int n = 0; n < 20000; ++n) {
    const int steps = NeighbourSteps(neighbourSteps(0.25 * (n % 10))).normal;
    Eigen::Vector3d exact(gauss(engine), gauss(engine), gauss(engine));
    if (n % 5 == 0) exact[n / 5 % 3] = exact[(n / 5 + 1) % 3];  // on the edge between two faces
    if (n % 7 == 0) exact[n / 7 % 3] = 0;
    exact.normalize();
    const Eigen::Vector3f normal = exact.cast<float>();
    Eigen::Vector3f rounded = normal;
    roundNormal(rounded.data(), steps);
    ASSERT_NEAR(rounded.cast<double>().norm(), 1, 3e-7);  // a root and a quotient in float32
    // Half a step along both edges of a cell.
    const double turn = rounded.cast<double>().cross(exact).norm();
    ASSERT_LT(turn, std::sqrt(0.5) / steps + 1e-6) << exact.transpose();
    for (int axis = 0; axis < 3; ++axis) ASSERT_FALSE(rounded[axis] == 0 && std::signbit(rounded[axis]));
    Eigen::Vector3f again = rounded, opposite = -normal;
    roundNormal(again.data(), steps);
    ASSERT_EQ(again, rounded);
    roundNormal(opposite.data(), steps);
    ASSERT_EQ(opposite, -rounded);
    const auto expected = test::gridPoint(normal.cast<double>(), steps, 1e-4);  // float32: 64 x 1e-7
    if (!expected) continue;
    std::int32_t found[3];
    normalInSteps(normal.data(), steps, found);
    ASSERT_EQ(Eigen::Vector3i(found[0], found[1], found[2]), *expected) << exact.transpose();
    ASSERT_LT((rounded.cast<double>() - expected->cast<double>().normalized()).norm(), 2e-7);
    ++compared;
  }
  EXPECT_GT(compared, 19000);
}

TEST(NormalSteps, ZeroStaysZero) {
  float none[3] = {0, 0, 0};
  roundNormal(none, 32);
  for (const float x : none) EXPECT_EQ(x, 0);
}

/// Turning a direction all the way round passes each grid point of its circle once.
TEST(NormalSteps, HaveOneOrderAroundTheCircle) {
  std::set<std::tuple<int, int, int>> seen;
  std::tuple<int, int, int> last;
  int changes = 0;
  constexpr int kTurns = 100000;
  for (int n = 0; n < kTurns; ++n) {
    const double angle = 2 * 3.141592653589793 * (n + 0.5) / kTurns;
    const float direction[3] = {static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0};
    std::int32_t steps[3];
    normalInSteps(direction, 12, steps);
    const auto now = std::make_tuple(steps[0], steps[1], steps[2]);
    if (n > 0 && now != last) ++changes;
    seen.insert(now);
    last = now;
  }
  EXPECT_EQ(seen.size(), 8u * 12);  // four edges of 24 steps each
  EXPECT_EQ(changes, 8 * 12);       // back to the first one
}

}  // namespace
}  // namespace accessvdb::kernels
