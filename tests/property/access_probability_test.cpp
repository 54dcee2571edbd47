// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How likely the tool reaches a point: what must hold of any constants, and that all ways to ask say the same.
#include "accessvdb/access_probability.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "field/query/access_probability.h"
#include "property/several_tools.h"

namespace accessvdb::test {
namespace {

constexpr int kLimit = 20;

FieldParams probabilityParams(double noise_voxels) {
  FieldParams params;
  params.tsdf.voxel_size_m = 0.01;
  params.tsdf.range_noise_m = noise_voxels * 0.01;
  return params.resolved();
}

SurfacePoint pointWith(PointReason reason, int score, float weight, float cosine) {
  SurfacePoint point;
  point.label = reason == PointReason::None ? PointLabel::Accessible : PointLabel::Blocked;
  point.reason = reason;
  point.score = score < 0 ? kNoScore : static_cast<std::uint16_t>(score);
  point.weight = weight;
  point.direction = 7;
  point.normal_W = {1, 0, 0};
  point.direction_W = {cosine, std::sqrt(1 - cosine * cosine), 0};
  return point;
}

/// One step worse in one thing, everything else the same: more collisions make no point likelier, and fewer
/// observations or more noise bring none nearer to what its label says.
TEST(AccessProbability, NothingWorseMakesALabelSurer) {
  const std::vector<float> weights = {0, 1, 2, 5, 12, 40, 200, 4000}, cosines = {0.35F, 0.5F, 0.8F, 1};
  const std::vector<double> noises = {0, 0.3, 0.5, 1, 2, 5};
  std::size_t compared = 0, falls = 0;
  const auto expectNotAbove = [&](float worse, float better, const std::string& what) {
    ASSERT_LE(worse, better) << what;
    ASSERT_GE(worse, 0);
    ASSERT_LE(better, 1);
    ++compared;
    falls += worse < better ? 1 : 0;
  };
  for (const PointReason reason : {PointReason::None, PointReason::Tool, PointReason::Arm, PointReason::Unknown}) {
    std::vector<int> scores = {-1};
    if (reason == PointReason::None) scores = {0, 1, 4, 10, 19};
    if (reason == PointReason::Tool) scores = {20, 21, 30, 60, 400, 4000};
    for (std::size_t s = 0; s < scores.size(); ++s) {
      for (std::size_t w = 0; w < weights.size(); ++w) {
        for (std::size_t n = 0; n < noises.size(); ++n) {
          for (const float cosine : cosines) {
            const auto of = [&](std::size_t score, std::size_t weight, std::size_t noise) {
              return accessProbability(pointWith(reason, scores[score], weights[weight], cosine), kLimit,
                                       probabilityParams(noises[noise]));
            };
            const float here = of(s, w, n);
            if (s > 0) expectNotAbove(here, of(s - 1, w, n), std::string("collisions, ") + name(reason));
            const auto expectLessSure = [&](float worse, float better, const std::string& what) {
              if (reason == PointReason::None) expectNotAbove(worse, better, what);
              if (reason != PointReason::None) expectNotAbove(better, worse, what);
            };
            if (w > 0) expectLessSure(of(s, w - 1, n), here, std::string("observations, ") + name(reason));
            if (n > 0) expectLessSure(here, of(s, w, n - 1), std::string("noise, ") + name(reason));
          }
        }
      }
    }
  }
  EXPECT_GT(compared, 5000U);
  EXPECT_GT(falls, 1000U);  // and it is not the same everywhere
}

TEST(AccessProbability, LessRoomDoesNotMakeAPointLikelier) {
  for (const int score : {0, 5, 19}) {
    float before = 0;
    for (const float margin_m : {0.0F, 0.005F, 0.01F, 0.02F, 0.04F, 0.2F}) {
      SurfacePoint point = pointWith(PointReason::None, score, 12, 0.7F);
      point.margin_m = margin_m;
      const float here = accessProbability(point, kLimit, probabilityParams(1));
      EXPECT_GE(here, before) << score << " " << margin_m;
      before = here;
    }
  }
}

TEST(AccessProbability, AccessiblePointsAreLikelierThanBlockedOnes) {
  const FieldParams params = probabilityParams(0.5);
  EXPECT_GT(accessProbability(pointWith(PointReason::None, 0, 40, 1), kLimit, params), 0.9F);
  EXPECT_LT(accessProbability(pointWith(PointReason::Tool, 400, 40, 1), kLimit, params), 0.2F);
}

/// Whole thousandths, and nothing of points that the method has not looked at.
TEST(AccessProbability, SaysNothingOfPointsThatWereNotJudged) {
  const FieldParams params = probabilityParams(1);
  for (const PointReason reason : {PointReason::Confidence, PointReason::Normal, PointReason::Unseen,
                                   PointReason::Changed, PointReason::BesideSurface}) {
    SurfacePoint point = pointWith(reason, -1, 5, 1);
    if (reason != PointReason::Normal && reason != PointReason::Unseen) point.label = PointLabel::Unscored;
    EXPECT_EQ(accessProbability(point, kLimit, params), -1) << name(reason);
  }
  SurfacePoint waiting = pointWith(PointReason::Tool, 30, 5, 1);
  waiting.label = PointLabel::Unscored;
  EXPECT_EQ(accessProbability(waiting, kLimit, params), -1);
  for (int score = 0; score < kLimit; ++score) {
    const float p = accessProbability(pointWith(PointReason::None, score, 9, 0.6F), kLimit, params);
    EXPECT_EQ(p, static_cast<float>(std::lround(1000 * p)) / 1000.0F) << score;
  }
  SurfacePoint damaged = pointWith(PointReason::None, 0, std::nanf(""), std::nanf(""));
  const float p = accessProbability(damaged, kLimit, params);
  EXPECT_LE(p, accessProbability(pointWith(PointReason::None, 0, 1, 0), kLimit, params));
}

/// Its own functions stand in for those of the C library, whose last bits differ between systems.
TEST(AccessProbability, SharesAndDoublingsAreThoseOfMathematics) {
  for (double odds = -8; odds <= 8; odds += 0.01) {
    // Between quarters straight: at most h^2 / 8 of the second derivative, 0.0963.
    EXPECT_NEAR(internal::shareOfOdds(static_cast<float>(odds)), 1 / (1 + std::exp(-odds)), 0.0963 / 128 + 1e-6);
  }
  EXPECT_EQ(internal::shareOfOdds(1e30F), internal::shareOfOdds(8));
  EXPECT_EQ(internal::shareOfOdds(std::nanf("")), internal::shareOfOdds(-8));
  for (float x = 1; x < 5000; x *= 1.01F) EXPECT_NEAR(internal::doublings(x), std::log2(x), 0.0861);
  for (int n = 0; n < 20; ++n) EXPECT_EQ(internal::doublings(static_cast<float>(1 << n)), static_cast<float>(n));
}

TEST(AccessProbability, OfThePapersProfileIsRefusedInOneLine) {
  const auto refusal = [](int limit, const FieldParams& params) {
    try {
      (void)accessProbability(pointWith(PointReason::None, 0, 9, 1), limit, params);
    } catch (const Error& error) {
      return error.id() + ": " + error.what();
    }
    return std::string("none");
  };
  const std::string text = refusal(kLimit, FieldParams::paper(0.01).resolved());
  EXPECT_TRUE(text.starts_with("probability.profile: ")) << text;
  EXPECT_EQ(text.find('\n'), std::string::npos);
  EXPECT_TRUE(refusal(0, probabilityParams(1)).starts_with("probability.limit: "));
}

/// Snapshot, look-up and function say the same; with margins, the room counts. In the paper's profile none is said.
TEST(AccessProbability, IsTheSameHoweverAFieldIsAsked) {
  FieldParams params = paramsAt(0.04);
  params.tsdf.range_noise_m = 0.01;
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  AccessibilityField alone(pruner, params), with_room(withMargins({{pruner}}, {0.04, 0.12}), params);
  FieldParams paper_params = FieldParams::paper(0.04);
  paper_params.backend = testedBackend();
  AccessibilityField paper(pruner, paper_params);
  for (const Scan& scan : wallScans(5, 6, 1500)) {
    for (AccessibilityField* field : {&alone, &with_room, &paper}) field->integrateScan(scan.points_S, scan.T_W_S);
  }
  for (AccessibilityField* field : {&alone, &with_room, &paper}) field->update();
  std::map<PointReason, int> said;
  const FieldSnapshot snapshot = alone.snapshot(), roomy = with_room.snapshot();
  bool differs = false;
  for (std::size_t n = 0; n < snapshot.points.size(); ++n) {
    const SurfacePoint &a = snapshot.points[n], &b = roomy.points[n];
    ASSERT_TRUE(same(a.access_probability, accessProbability(a, alone.collisionLimit(), alone.params()))) << n;
    ASSERT_TRUE(same(b.access_probability, accessProbability(b, with_room.collisionLimit(), with_room.params()))) << n;
    ASSERT_EQ(a.access_probability >= 0, b.access_probability >= 0);
    differs = differs || a.access_probability != b.access_probability;
    if (a.access_probability >= 0) ++said[a.reason];
  }
  EXPECT_GT(said[PointReason::None], 50);
  EXPECT_GT(said[PointReason::Tool], 50);
  EXPECT_TRUE(differs);
  const SurfacePoint& some = snapshot.points.at(snapshot.points.size() / 2);
  EXPECT_TRUE(same(alone.pointAt(some.position_W).value().access_probability, some.access_probability));
  for (const SurfacePoint& point : paper.snapshot().points) ASSERT_EQ(point.access_probability, -1);
}

}  // namespace
}  // namespace accessvdb::test
