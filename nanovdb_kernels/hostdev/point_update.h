// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How an evaluation changes a point's stored state (paper, "Incremental Updates and Confidence"; SPEC a.9).
#pragma once

#include "direction_search.h"

namespace accessvdb::kernels {

/// Constants of the state update.
struct UpdateRule {
  bool keep_best = false;    ///< paper: the best score never rises, and the label needs stability
  float half_weight = 5.0f;  ///< [k_c]
  float stability_min = 0.7f;
  std::uint16_t collision_limit = 1;  ///< [n_c]
};

/// Confidence in the map at a point, c = w / (w + k_c).
ACCESSVDB_HOSTDEV inline float confidenceOf(float weight, float half_weight) { return weight / (weight + half_weight); }

/// Updates the stored state of a point and tells the result what is stored now.
ACCESSVDB_HOSTDEV inline void updatePoint(const PointStateView& points, std::uint32_t id, ScoreResult& result,
                                          const UpdateRule& rule) {
  constexpr float kDecay = 0.75f, kRecovery = 0.15f;
  if (result.scored == 0) {
    points.score[id] = kNoScore;
    points.direction[id] = kNoDirection;
    points.label[id] = PointLabel::Unscored;
    points.reason[id] = PointReason::Normal;
    points.flags[id] = 0;
    return;
  }
  const bool free_now = result.score < rule.collision_limit;
  const bool was_free =
      rule.keep_best ? points.score[id] < rule.collision_limit : points.label[id] == PointLabel::Accessible;
  float a = points.stability[id];
  if (was_free) a = free_now ? a + kRecovery * (1.0f - a) : a * kDecay;
  points.stability[id] = a;

  // A blocked point that stays blocked, with some directions skipped because they are known to be blocked: what is
  // stored is the closest of all directions, the result only that of the rest.
  const bool partial = !rule.keep_best && result.skipped != 0 && !free_now && points.label[id] == PointLabel::Blocked;
  if (!partial && (!rule.keep_best || result.score < points.score[id] || points.score[id] == kNoScore)) {
    points.score[id] = result.score;
    points.direction[id] = result.direction;
    points.reason[id] = result.reason;
  }
  const bool accessible = points.score[id] < rule.collision_limit && (!rule.keep_best || a > rule.stability_min);
  points.label[id] = accessible ? PointLabel::Accessible : PointLabel::Blocked;
  if (accessible) {
    points.reason[id] = PointReason::None;
  } else if (points.reason[id] == PointReason::None) {
    points.reason[id] = result.reason == PointReason::None ? PointReason::Tool : result.reason;
  }
  const float c = confidenceOf(static_cast<float>(points.weight[id]), rule.half_weight);
  points.flags[id] = accessible && c * a > rule.stability_min ? kConfident : 0;
  result.label = points.label[id];
  result.stored_score = points.score[id];
  result.stored_direction = points.direction[id];
}

}  // namespace accessvdb::kernels
