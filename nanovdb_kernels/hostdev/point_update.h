// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How an evaluation changes a point's stored state (paper, "Incremental Updates and Confidence"; docs/PAPER_MAP.md,
/// "Label and stability").
#pragma once

#include "direction_search.h"
#include "surface_choice.h"

namespace accessvdb::kernels {

/// Constants of the state update.
struct UpdateRule {
  bool keep_best = false;  ///< paper: the best score never rises, and the label needs stability
  float stability_min = 0.7f;
  std::uint16_t collision_limit = 1;  ///< [n_c]
};

/// Confidence in the map at a point, c = w / (w + k_c).
ACCESSVDB_HOSTDEV inline float confidenceOf(float weight, float half_weight) { return weight / (weight + half_weight); }

/// Updates the stored state of a point and copies it into the result.
///
/// The stored state does not depend on evaluations that only confirm it: how often map changes cause a point to be
/// evaluated is up to the scheduler (ScoreItem::evidence, keep_reason).
ACCESSVDB_HOSTDEV inline void updatePoint(const PointStateView& points, const ScoreItem& item, ScoreResult& result,
                                          const UpdateRule& rule) {
  constexpr float kDecay = 0.75f, kRecovery = 0.15f;
  const std::uint32_t id = item.id;
  if (result.scored == 0) {
    points.score[id] = kNoScore;
    points.direction[id] = kNoDirection;
    if (points.roll != nullptr) points.roll[id] = 0;
    points.label[id] = PointLabel::Unscored;
    const bool beside = besideSurfaceAxis(points.normal_L + 3 * static_cast<std::size_t>(id)) >= 0;
    points.reason[id] = beside ? PointReason::BesideSurface : PointReason::Normal;
    return;
  }
  const std::uint16_t score_before = points.score[id], direction_before = points.direction[id];
  const PointLabel label_before = points.label[id];
  const bool free_now = result.score < rule.collision_limit;
  const bool was_free = rule.keep_best ? score_before < rule.collision_limit : label_before == PointLabel::Accessible;
  float a = points.stability[id];
  if (was_free) a = free_now ? a + kRecovery * (1.0f - a) : a * kDecay;

  std::uint16_t score = score_before, direction = direction_before;
  PointReason reason = points.reason[id];
  const bool keeps = !rule.keep_best && item.keep_reason != 0 && !free_now && label_before == PointLabel::Blocked;
  if (!keeps && (!rule.keep_best || result.score < score_before || score_before == kNoScore)) {
    score = result.score;
    direction = result.direction;
    reason = result.reason;
    if (points.roll != nullptr) points.roll[id] = result.roll;
  }
  const bool accessible = score < rule.collision_limit && (!rule.keep_best || a > rule.stability_min);
  const PointLabel label = accessible ? PointLabel::Accessible : PointLabel::Blocked;
  if (accessible) {
    reason = PointReason::None;
  } else if (reason == PointReason::None) {
    reason = result.reason == PointReason::None ? PointReason::Tool : result.reason;
  }
  points.score[id] = score;
  points.direction[id] = direction;
  points.label[id] = label;
  points.reason[id] = reason;
  if (item.evidence != 0 || label != label_before || score != score_before || direction != direction_before) {
    points.stability[id] = a;
  }
  result.label = label;
  result.stored_score = score;
  result.stored_direction = direction;
  result.stored_roll = static_cast<std::uint8_t>(points.rollOf(id));
}

}  // namespace accessvdb::kernels
