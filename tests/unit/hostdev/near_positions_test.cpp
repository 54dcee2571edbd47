// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "hostdev/near_positions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "hostdev/neighbour_rule.h"

namespace accessvdb::kernels {
namespace {

struct Counts {
  int compared = 0, not_exact = 0, different = 0;
};

/// Compares with neighbourOffset(), along x.
/// @param requires_exact  leave out offsets from positions of which something is cut off
Counts compare(const std::vector<float>& positions_m, double steps_per_m, bool requires_exact = true) {
  float low = positions_m[0], high = low;
  for (const float p : positions_m) low = std::min(low, p), high = std::max(high, p);
  const double width_m = static_cast<double>(high) - static_cast<double>(low);
  const auto fractions = PositionFractions::forWidth(width_m * steps_per_m, steps_per_m);
  const std::int64_t origin = fractions.of(low);
  const auto positionOf = [&](float p) { return static_cast<std::int32_t>(fractions.of(p) - origin); };
  Counts counts;
  for (const float from : positions_m) {
    if (requires_exact && !fractions.areExactAt(from)) {
      ++counts.not_exact;
      continue;
    }
    for (const float to : positions_m) {
      if (!hasExactOffsets(to)) continue;
      const float a[3] = {from, 0, 0}, b[3] = {to, 0, 0};
      ++counts.compared;
      if (fractions.offset(positionOf(from), positionOf(to)) != neighbourOffset(a, b, steps_per_m).x)
        ++counts.different;
    }
  }
  return counts;
}

std::vector<float> positionsAround(float centre_m, float half_m, int count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> anywhere(centre_m - half_m, centre_m + half_m);
  std::vector<float> positions(static_cast<std::size_t>(count));
  for (float& p : positions) p = anywhere(random);
  return positions;
}

TEST(NearPositions, GiveTheOffsetsOfTheRule) {
  for (const double radius_m : {0.1, 0.2, 0.5, 2.0}) {
    const double steps_per_m = neighbourStepsPerMetre(radius_m);
    for (const float centre_m : {0.0f, 0.3f, -1.7f, 25.0f, -180.0f, 4000.0f}) {
      const Counts counts = compare(positionsAround(centre_m, static_cast<float>(1.2 * radius_m), 200), steps_per_m);
      EXPECT_EQ(counts.different, 0) << radius_m << " m around " << centre_m;
      EXPECT_GT(counts.compared, 100) << radius_m << " m around " << centre_m;
    }
  }
}

TEST(NearPositions, GiveThemWhereOffsetsAreHalfASteps) {
  const double steps_per_m = neighbourStepsPerMetre(0.1);
  std::vector<float> positions;
  for (int n = -100; n < 100; ++n) {
    const auto at = static_cast<float>((4096 + n / 2.0) / steps_per_m);  // every second one lies between two steps
    for (const float p : {std::nextafter(at, 0.0f), at, std::nextafter(at, 1.0f)}) positions.push_back(p);
  }
  const Counts counts = compare(positions, steps_per_m);
  EXPECT_EQ(counts.different, 0);
  EXPECT_EQ(counts.not_exact, 400);  // the ones beside have more bits
}

/// The other end may have more bits than fit, this one may not.
TEST(NearPositions, NeedAnExactBeginning) {
  const double steps_per_m = neighbourStepsPerMetre(0.1);
  std::vector<float> positions = positionsAround(0, 0.0005f, 500);
  positions.push_back(0.0f);
  positions.push_back(0.2f);  // far away, so that there are fewer fractions
  const Counts exact = compare(positions, steps_per_m), all = compare(positions, steps_per_m, false);
  EXPECT_EQ(exact.different, 0);
  EXPECT_GT(exact.compared, 500);
  EXPECT_GT(exact.not_exact, 100);
  EXPECT_GT(all.different, 0);
}

TEST(NearPositions, FitInto32BitsOrHaveNoFractions) {
  const double steps_per_m = 1 << 20;
  for (double width_steps = 1; width_steps < 1e12; width_steps *= 1.7) {
    const auto fractions = PositionFractions::forWidth(width_steps, steps_per_m);
    EXPECT_LE(fractions.bits, PositionFractions::kMostBits);
    if (fractions.bits == 0) {
      EXPECT_GT(width_steps, 1 << 28);
    } else {
      EXPECT_LT(width_steps * (1 << fractions.bits), 1 << 30);
    }
  }
}

TEST(NearPositions, KnowWhichPositionsADoubleCannotSubtract) {
  EXPECT_TRUE(hasExactOffsets(0.0f));
  EXPECT_TRUE(hasExactOffsets(0.01f));
  EXPECT_TRUE(hasExactOffsets(-0.01f));
  EXPECT_FALSE(hasExactOffsets(1e-9f));
  EXPECT_FALSE(hasExactOffsets(-1e-30f));
  // One such end: the difference as a double is a half and rounds up, the exact one is less.
  const double steps_per_m = neighbourStepsPerMetre(0.1);
  const float half = static_cast<float>(0.5 / steps_per_m), a[3] = {half, 0, 0}, b[3] = {-1e-30f, 0, 0};
  const auto fractions = PositionFractions::forWidth(1000, steps_per_m);
  const auto origin = fractions.of(-0.001f);
  EXPECT_NE(fractions.offset(static_cast<std::int32_t>(fractions.of(half) - origin),
                             static_cast<std::int32_t>(fractions.of(b[0]) - origin)),
            neighbourOffset(a, b, steps_per_m).x);
}

}  // namespace
}  // namespace accessvdb::kernels
