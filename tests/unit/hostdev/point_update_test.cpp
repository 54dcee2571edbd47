// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The state of a point over several evaluations, with hand-computed numbers.
#include "hostdev/point_update.h"

#include <gtest/gtest.h>

namespace accessvdb::test {
namespace {

/// One point and its rule.
struct Point {
  std::uint16_t score = kNoScore, direction = kNoDirection, weight = 100;
  float stability = 1;
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  kernels::UpdateRule rule;

  explicit Point(bool keep_best, std::uint16_t limit = 5) {
    rule.keep_best = keep_best;
    rule.collision_limit = limit;
  }
  kernels::ScoreResult evaluate(std::uint16_t new_score, std::uint16_t new_direction, PointReason why,
                                bool keep_reason = false, bool evidence = true) {
    kernels::PointStateView view;
    view.score = &score;
    view.direction = &direction;
    view.weight = &weight;
    view.stability = &stability;
    view.label = &label;
    view.reason = &reason;
    kernels::ScoreResult result;
    result.scored = 1;
    result.score = new_score;
    result.direction = new_direction;
    result.reason = why;
    kernels::ScoreItem item;
    item.keep_reason = keep_reason ? 1 : 0;
    item.evidence = evidence ? 1 : 0;
    kernels::updatePoint(view, item, result, rule);
    EXPECT_EQ(result.label, label);
    EXPECT_EQ(result.stored_score, score);
    EXPECT_EQ(result.stored_direction, direction);
    return result;
  }
  void clear(std::uint16_t s = 0, std::uint16_t d = 7) { evaluate(s, d, PointReason::None); }
  void conflict(std::uint16_t s = 30, std::uint16_t d = 9) { evaluate(s, d, PointReason::Tool); }
};

TEST(ConfidenceOf, IsAHalfAtTheHalfWeight) {
  EXPECT_FLOAT_EQ(kernels::confidenceOf(0, 5), 0);
  EXPECT_FLOAT_EQ(kernels::confidenceOf(5, 5), 0.5f);
  EXPECT_FLOAT_EQ(kernels::confidenceOf(1.25f, 5), 0.2f);
  EXPECT_FLOAT_EQ(kernels::confidenceOf(2000, 5), 2000.0f / 2005.0f);
}

TEST(UpdatePointPaper, OneClearEvaluationTwoConflicts) {
  Point point(true);
  point.conflict(30, 9);
  EXPECT_EQ(point.label, PointLabel::Blocked);
  EXPECT_EQ(point.reason, PointReason::Tool);
  EXPECT_EQ(point.score, 30);
  EXPECT_FLOAT_EQ(point.stability, 1);  // never accessible: nothing to lose
  point.clear(3, 7);
  EXPECT_EQ(point.label, PointLabel::Accessible);
  EXPECT_EQ(point.reason, PointReason::None);
  EXPECT_EQ(point.score, 3);
  EXPECT_EQ(point.direction, 7);
  EXPECT_FLOAT_EQ(point.stability, 1);
  point.conflict(40, 11);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);
  EXPECT_EQ(point.label, PointLabel::Accessible);  // 0.75 > 0.7
  EXPECT_EQ(point.score, 3);                       // the best never rises
  EXPECT_EQ(point.direction, 7);
  point.conflict(40, 11);
  EXPECT_FLOAT_EQ(point.stability, 0.5625f);
  EXPECT_EQ(point.label, PointLabel::Blocked);
  EXPECT_EQ(point.reason, PointReason::Tool);
  EXPECT_EQ(point.score, 3);
}

TEST(UpdatePointPaper, RecoveryTakesThreeConfirmations) {
  Point point(true);
  point.clear();
  point.conflict();
  point.conflict();
  ASSERT_FLOAT_EQ(point.stability, 0.5625f);
  point.clear();
  EXPECT_FLOAT_EQ(point.stability, 0.628125f);  // 0.5625 + 0.15 x 0.4375
  EXPECT_EQ(point.label, PointLabel::Blocked);
  point.clear();
  EXPECT_FLOAT_EQ(point.stability, 0.68390625f);
  EXPECT_EQ(point.label, PointLabel::Blocked);
  point.clear();
  EXPECT_FLOAT_EQ(point.stability, 0.7313203125f);
  EXPECT_EQ(point.label, PointLabel::Accessible);
  EXPECT_EQ(point.reason, PointReason::None);
}

TEST(UpdatePointPaper, TheBoundsAreStrict) {
  Point point(true, 5);
  point.clear(5, 1);  // a count at the limit is a collision, whatever the caller claims
  EXPECT_EQ(point.label, PointLabel::Blocked);
  point.clear(4, 2);
  EXPECT_EQ(point.label, PointLabel::Accessible);
  Point edge(true);
  edge.clear();
  edge.stability = 0.7f / 0.75f;  // one conflict brings it to 0.7, which is not above 0.7
  edge.conflict();
  EXPECT_NEAR(edge.stability, 0.7, 1e-6);
  edge.stability = 0.7f;
  edge.score = 0;
  edge.rule.stability_min = edge.stability + 0.15f * (1.0f - edge.stability);
  edge.clear();
  EXPECT_EQ(edge.label, PointLabel::Blocked);
}

TEST(UpdatePointProduct, LabelFollowsTheLatestEvaluation) {
  Point point(false);
  point.clear(2, 7);
  EXPECT_EQ(point.label, PointLabel::Accessible);
  point.conflict(40, 11);
  EXPECT_EQ(point.label, PointLabel::Blocked);
  EXPECT_EQ(point.score, 40);
  EXPECT_EQ(point.direction, 11);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);
  point.conflict(41, 12);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);  // only an accessible point has something to lose
  point.clear(3, 8);
  EXPECT_EQ(point.label, PointLabel::Accessible);
  EXPECT_EQ(point.score, 3);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);  // it was not free before
  point.clear(3, 8);
  EXPECT_FLOAT_EQ(point.stability, 0.7875f);
}

TEST(UpdatePointProduct, PartialResultsKeepTheClosestDirection) {
  Point point(false);
  point.evaluate(12, 4, PointReason::Tool);
  point.evaluate(kNoScore, 20, PointReason::Arm, true);  // others were skipped: what is stored is closer
  EXPECT_EQ(point.score, 12);
  EXPECT_EQ(point.direction, 4);
  EXPECT_EQ(point.reason, PointReason::Tool);
  point.evaluate(kNoScore, 20, PointReason::Arm, false);
  EXPECT_EQ(point.score, kNoScore);
  EXPECT_EQ(point.direction, 20);
  EXPECT_EQ(point.reason, PointReason::Arm);
  point.evaluate(1, 21, PointReason::None, true);  // free is free
  EXPECT_EQ(point.label, PointLabel::Accessible);
  EXPECT_EQ(point.direction, 21);
}

/// How often a scheduler evaluates a point because of nearby changes must not matter.
TEST(UpdatePointProduct, ConfirmationsWithoutEvidenceChangeNothing) {
  Point point(false);
  point.clear(2, 7);
  point.conflict(40, 11);
  point.clear(3, 8);
  ASSERT_FLOAT_EQ(point.stability, 0.75f);
  point.evaluate(3, 8, PointReason::None, false, false);
  EXPECT_FLOAT_EQ(point.stability, 0.75f);
  point.evaluate(2, 8, PointReason::None, false, false);  // another count is another outcome
  EXPECT_FLOAT_EQ(point.stability, 0.7875f);
  point.evaluate(2, 9, PointReason::None, false, false);  // and so is another direction
  EXPECT_FLOAT_EQ(point.stability, 0.819375f);
  point.evaluate(40, 11, PointReason::Tool, false, false);
  EXPECT_FLOAT_EQ(point.stability, 0.61453125f);
  point.evaluate(41, 12, PointReason::Tool, true, false);
  EXPECT_EQ(point.direction, 11);
  EXPECT_FLOAT_EQ(point.stability, 0.61453125f);
}

/// Nor of a point beside the surface, whose reason tells which it is.
TEST(UpdatePoint, WithoutANormalNothingIsKept) {
  for (const bool keep_best : {false, true}) {
    for (const int beside : {-1, 0, 1, 2}) {
      Point point(keep_best);
      point.clear();
      float normal[3] = {0, 0, 0};
      if (beside >= 0) kernels::writeBesideSurface(beside, normal);
      kernels::PointStateView view;
      view.normal_L = normal;
      view.score = &point.score;
      view.direction = &point.direction;
      view.weight = &point.weight;
      view.stability = &point.stability;
      view.label = &point.label;
      view.reason = &point.reason;
      kernels::ScoreResult result;
      kernels::updatePoint(view, kernels::ScoreItem{}, result, point.rule);
      EXPECT_EQ(point.label, PointLabel::Unscored);
      EXPECT_EQ(result.label, PointLabel::Unscored);
      EXPECT_EQ(point.reason, beside < 0 ? PointReason::Normal : PointReason::BesideSurface);
      EXPECT_EQ(point.score, kNoScore);
      EXPECT_EQ(point.direction, kNoDirection);
    }
  }
}

}  // namespace
}  // namespace accessvdb::test
