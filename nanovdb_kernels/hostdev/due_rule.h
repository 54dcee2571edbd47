// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What must be evaluated at a point under the exact policy, and in which of its directions (docs/DESIGN.md, "Exact
/// updates").
///
/// After an update everything is known about a point: an accessible one has its best direction and count, a blocked one
/// has no free direction. Only directions that are newly admissible, or that a flip for the better may have changed,
/// can change that; and for the best direction a flip for the worse. Requesting too many directions costs time and
/// changes nothing; requesting too few would be wrong.
#pragma once

#include <cstdint>

#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {

/// Directions that flips of the map may have changed for the points of a group.
struct GroupMasks {
  DirectionMask better_tool, better_arm, worse_tool, worse_arm;
};

/// What determines the directions that a point admits: its normal and the directions it was seen from.
struct PointDirections {
  float normal[3];
  DirectionMask seen;

  [[nodiscard]] ACCESSVDB_HOSTDEV bool hasNormal() const { return normal[0] != 0 || normal[1] != 0 || normal[2] != 0; }
  /// @param cosine  cosToNormal() of direction d
  [[nodiscard]] ACCESSVDB_HOSTDEV bool admits(const ApproachView& approach, int d, float cosine) const {
    return seen.test(d) && cosine >= approach.normal_cos_min;
  }
};

/// What the last evaluation of a point stored.
struct StoredScore {
  PointLabel label;
  int direction;  ///< the best one, or the one that determined the reason; kNoDirection
  int score;
  int roll = 0;  ///< in that direction
};

/// A point in its current state.
struct PointNow {
  const ApproachView& approach;
  StoredScore stored;
  const PointDirections& directions;
};

/// Bits of Due::test_best.
enum TestBest : std::uint8_t { kTestArm = 1, kTestTool = 2 };

enum class DueKind : std::uint8_t {
  Nothing,  ///< the stored result still holds
  Confirm,  ///< an accessible point changed, or its score, but its best direction is still the best one
  Some,     ///< test the best direction as Due::test_best says, and the candidates
  All       ///< test all directions
};

struct Due {
  DueKind kind = DueKind::Nothing;
  std::uint8_t test_best = 0;  ///< TestBest: whether the best direction may have changed
  std::uint8_t evidence = 0;   ///< ScoreItem::evidence
  /// Collisions of an accessible point's best direction, if they are known without a test of the tool; else kNoScore.
  std::uint16_t best_score = kNoScore;
  DirectionMask candidates = {};
};

/// A point's best direction, if the point still admits it.
struct BestDirection {
  bool holds;
  int direction;
  float cosine;

  ACCESSVDB_HOSTDEV explicit BestDirection(const PointNow& point)
      : holds(false), direction(point.stored.direction), cosine(0) {
    if (!point.directions.hasNormal() || direction == kNoDirection) return;
    cosine = cosToNormal(point.approach, direction, point.directions.normal);
    holds = point.directions.admits(point.approach, direction, cosine);
  }
  /// Clears this direction's bit in word w of a mask.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::uint64_t without(std::uint64_t mask, int w) const {
    return direction >> 6 == w ? mask & ~(std::uint64_t{1} << (direction & 63)) : mask;
  }
};

/// Takes the collisions of an accessible point's best direction where they are known, else has the tool tested there.
/// @param flips  as for dueAfterChange  @param score  in: stored; out: now
/// @return false if the direction is blocked: then all are due
template <class Flips>
[[nodiscard]] ACCESSVDB_HOSTDEV bool takeKnownScore(const Flips& flips, int direction, Due& due, int& score) {
  const int known = flips.collisionsOf(direction);
  if (known == kNoScore) {
    due.test_best |= kTestTool;
  } else if (known >= flips.limit()) {
    due.kind = DueKind::All;
    return false;
  } else {
    due.best_score = static_cast<std::uint16_t>(known);
    score = known;
  }
  return true;
}

/// What is due because the point or the map around it changed.
/// @param before   the point's directions at the last update; equal to those of `point` if it did not change
/// @param changed  whether they differ; if so, the stored result is at least confirmed
/// @param flips    flips.masks(): GroupMasks; flips.notKnownWorse(w, asked, most): those of the requested directions in
///   64 w .. 64 w + 63 that are not known to have more collisions, or a blocked corridor; flips.collisionsOf(d): what
///   an accessible point's best direction has now, kNoScore if it must be tested; flips.bestArmMayBeBlocked(): whether
///   the masks hold for its corridor, which they name for a group; flips.limit(): so many block a direction. All but
///   the last are called only if needed.
template <class Flips>
[[nodiscard]] ACCESSVDB_HOSTDEV Due dueAfterChange(const PointNow& point, const PointDirections& before, bool changed,
                                                   const Flips& flips) {
  Due due;
  due.evidence = changed ? 1 : 0;
  const BestDirection best(point);
  if (point.stored.label == PointLabel::Unscored || !best.holds) {
    // An accessible point lost its direction, or a blocked one the direction that determined its reason. If nothing
    // changed, it is a blocked point without any admissible direction.
    if (changed) due.kind = DueKind::All;
    return due;
  }
  const ApproachView& approach = point.approach;
  const PointDirections& now = point.directions;
  const bool accessible = point.stored.label == PointLabel::Accessible;
  int score = point.stored.score;
  const GroupMasks masks = flips.masks();
  const float best_cosine_before = cosToNormal(approach, best.direction, before.normal);
  if (accessible) {
    if (masks.worse_arm.test(best.direction) && flips.bestArmMayBeBlocked()) due.test_best |= kTestArm;
    // What became free may also let an earlier roll have as few collisions.
    const bool may_improve = score > 0 || point.stored.roll > 0;
    if (masks.worse_tool.test(best.direction) || (may_improve && masks.better_tool.test(best.direction))) {
      if (!takeKnownScore(flips, best.direction, due, score)) return due;
    }
  }
  const bool became_worse = score > point.stored.score;
  const int most = accessible ? score : flips.limit() - 1;
  // Nothing is better than a best direction without collisions but what comes before it.
  const DirectionMask around =
      aroundNormal(approach, now.normal, accessible && score == 0 ? best.cosine : approach.normal_cos_min);
  bool some = false;
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    const std::uint64_t better = masks.better_tool.word[w] | masks.better_arm.word[w];
    std::uint64_t asked = now.seen.word[w] & around.word[w] & (changed || became_worse ? ~std::uint64_t{0} : better);
    if (accessible) asked = best.without(asked, w);
    asked = flips.notKnownWorse(w, asked, most);
    std::uint64_t candidates = 0;
    for (; asked != 0; asked &= asked - 1) {
      const int bit = lowestBit(asked), d = 64 * w + bit;
      const float cosine = cosToNormal(approach, d, now.normal);
      if (!now.admits(approach, d, cosine)) continue;
      bool wanted = became_worse || (better >> bit & 1u) != 0;
      bool is_before = true;  // can it be better than the best one?
      if (accessible) is_before = ranksBefore(cosine, d, best.cosine, best.direction);
      if (changed && !wanted) {
        const float cosine_before = cosToNormal(approach, d, before.normal);
        wanted = !before.admits(approach, d, cosine_before) ||
                 (accessible && is_before && !ranksBefore(cosine_before, d, best_cosine_before, best.direction));
      }
      if (wanted && (!accessible || is_before || score > 0)) candidates |= std::uint64_t{1} << bit;
    }
    due.candidates.word[w] = candidates;
    some = some || candidates != 0;
  }
  if (some || due.test_best != 0) {
    due.kind = DueKind::Some;
  } else if (accessible && (changed || score != point.stored.score)) {
    due.kind = DueKind::Confirm;
  }
  return due;
}

/// What is due at a point that waited in the queue: whatever may have changed in the meantime. Knowledge about its
/// directions has aged with every update, so directions known to be worse still are.
/// @param evidence  whether the point itself changed while it waited (ScoreItem::evidence)
template <class Flips>
[[nodiscard]] ACCESSVDB_HOSTDEV Due dueAfterWaiting(const PointNow& point, bool evidence, const Flips& flips) {
  Due due;
  due.evidence = evidence ? 1 : 0;
  const BestDirection best(point);
  if (point.stored.label == PointLabel::Unscored || !best.holds) {
    due.kind = DueKind::All;
    return due;
  }
  due.kind = DueKind::Some;
  const PointDirections& now = point.directions;
  const bool accessible = point.stored.label == PointLabel::Accessible;
  int score = point.stored.score;
  if (accessible) {
    due.test_best = kTestArm;
    if (!takeKnownScore(flips, best.direction, due, score)) return due;
  }
  const int most = accessible ? score : flips.limit() - 1;
  const DirectionMask around =
      aroundNormal(point.approach, now.normal, accessible && score == 0 ? best.cosine : point.approach.normal_cos_min);
  ACCESSVDB_UNROLL
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    std::uint64_t asked = now.seen.word[w] & around.word[w], candidates = 0;
    if (accessible) asked = best.without(asked, w);
    asked = flips.notKnownWorse(w, asked, most);
    for (; asked != 0; asked &= asked - 1) {
      const int bit = lowestBit(asked), d = 64 * w + bit;
      const float cosine = cosToNormal(point.approach, d, now.normal);
      if (!now.admits(point.approach, d, cosine)) continue;
      if (accessible && score == 0 && !ranksBefore(cosine, d, best.cosine, best.direction)) continue;
      candidates |= std::uint64_t{1} << bit;
    }
    due.candidates.word[w] = candidates;
  }
  return due;
}

}  // namespace accessvdb::kernels
