// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Evaluates a point under the exact policy (hostdev/due_rule.h), one direction after the other, and remembers what was
/// found out about its directions (hostdev/known_levels.h).
#pragma once

#include <cstdint>

#include "hostdev/due_rule.h"
#include "hostdev/known_levels.h"
#include "hostdev/point_update.h"

namespace accessvdb::kernels {

/// What is remembered about a point's directions.
struct KnownPoint {
  std::uint64_t* levels = nullptr;   ///< [words] eight directions each
  const FreedWord* freed = nullptr;  ///< [words] of the point's group
  int words = 0;
};

/// Constants of an update.
struct KnownScale {
  KnownLevels levels;
  int count_to = 0;  ///< collisions are counted up to here, to remember them

  /// For a processor, where counting on costs little: as far as levels reach.
  static KnownScale forLimit(int collision_limit) {
    const KnownLevels levels = KnownLevels::forLimit(collision_limit);
    const int most = collision_limit + static_cast<int>(KnownLevels::kMost << levels.log2);
    return {levels, most < kNoScore ? most : kNoScore};
  }
};

/// Directions that may be in question if the best one has `more` collisions more than before.
ACCESSVDB_HOSTDEV inline DirectionMask askedUnlessKnownWorse(const KnownPoint& known, const KnownLevels& scale,
                                                             int more) {
  constexpr std::uint32_t kMost = KnownLevels::kMost - KnownLevels::kMostFreedSteps + 1;
  const std::uint32_t steps = (static_cast<std::uint32_t>(more) + (1u << scale.log2) - 1) >> scale.log2;
  DirectionMask asked = {};
  for (int w = 0; w < known.words; ++w) {
    // No level guarantees more than kMost steps; beyond that only corridors count.
    const std::uint64_t lowest = steps <= kMost ? known.freed[w].lowestWithMore(scale.log2) + known_word::kEach * steps
                                                : known_word::kEach * (KnownLevels::kMost + 1);
    const std::uint64_t wanted = ~known_word::worse(known.levels[w], lowest) & 0xffu;
    asked.word[w >> 3] |= wanted << (8 * (w & 7));
  }
  return asked;
}

/// Lower bound of a point's collisions in direction d; 0: nothing is known. @param base  baseCollisions
ACCESSVDB_HOSTDEV inline int knownCollisions(const KnownPoint& known, const KnownLevels& scale, int base, int d) {
  const int w = d / kKnownPerWord, n = d % kKnownPerWord;
  const std::uint32_t level = known_word::levelIn(known.levels[w], n);
  if (level == 0) return 0;
  const int collisions = base + scale.collisionsOf(level, known.freed[w].count(n, scale.log2));
  return collisions > 0 ? collisions : 0;
}

/// What a search found out.
struct SearchNotes {
  DirectionMask arm_free = {}, arm_blocked = {}, counted = {};
  std::uint16_t least[64 * kMaxDirectionWords];  ///< lower bound of the collisions of each counted direction
};

/// Tests that take notes and make use of what is known. @tparam Tests  as for searchDirections
template <class Tests>
struct NotingTests {
  const Tests& tests;
  const KnownPoint& known;
  const KnownScale& scale;
  int base;  ///< what the levels count from
  SearchNotes& notes;

  [[nodiscard]] ACCESSVDB_HOSTDEV ArmResult arm(int d) const {
    const ArmResult arm = tests.arm(d);
    (arm.reason == PointReason::None ? notes.arm_free : notes.arm_blocked).set(d);
    return arm;
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV AxisCount collisions(int d, int stop_above) const {
    const int least = knownCollisions(known, scale.levels, base, d);
    if (least > stop_above) return {least, 0};
    const AxisCount counted = tests.collisions(d, stop_above < scale.count_to - 1 ? scale.count_to - 1 : stop_above);
    const int hits = counted.count < kNoScore ? counted.count : kNoScore - 1;
    notes.counted.set(d);
    notes.least[d] = static_cast<std::uint16_t>(hits);
    return {hits, counted.roll};
  }
};

/// Remembers what an evaluation found out. @param before, after  baseCollisions
ACCESSVDB_HOSTDEV inline void learn(const KnownPoint& known, const KnownLevels& scale, const SearchNotes& notes,
                                    int before, int after) {
  const auto learnWord = [&](int w) {
    const auto of = [w](const DirectionMask& mask) {
      return static_cast<std::uint32_t>(mask.word[w >> 3] >> (8 * (w & 7))) & 0xffu;
    };
    std::uint64_t levels =
        (known.levels[w] & ~known_word::spread(of(notes.arm_free))) | known_word::spread(of(notes.arm_blocked));
    if (before != after) levels = known_word::rebased(levels, after - before, scale.log2);
    for (std::uint32_t bits = of(notes.counted); bits != 0; bits &= bits - 1) {
      const int n = lowestBit(bits);
      const std::uint32_t level =
          scale.levelOf(notes.least[w * kKnownPerWord + n] - after, known.freed[w].count(n, scale.log2));
      if (level > known_word::levelIn(levels, n)) levels = known_word::withLevel(levels, n, level);
    }
    known.levels[w] = levels;
  };
  if (before != after) {
    for (int w = 0; w < known.words; ++w) learnWord(w);
    return;
  }
  for (int i = 0; i < kMaxDirectionWords; ++i) {
    for (std::uint64_t tested = notes.arm_free.word[i] | notes.arm_blocked.word[i]; tested != 0;) {
      const int byte = lowestBit(tested) >> 3;
      learnWord(8 * i + byte);
      tested &= ~(std::uint64_t{0xff} << (8 * byte));
    }
  }
}

/// What an evaluation left behind.
struct DueOutcome {
  std::uint32_t tests = 0;
  PointLabel label_before = PointLabel::Unscored;
  // The point's stored state.
  PointLabel label = PointLabel::Unscored;
  std::uint16_t score = kNoScore, direction = kNoDirection;
  std::uint8_t roll = 0;
};

/// Evaluates one point. @tparam Tests  as for searchDirections
/// @tparam Nearest  nearest(approach, normal) as DirectionWalk::nearestDirection
template <class Tests, class Nearest>
class DueEvaluation {
 public:
  /// Constants of the update.
  struct Update {
    const ApproachView& approach;
    const PointStateView& points;
    const UpdateRule& rule;
    const KnownScale& scale;
    Nearest nearest;
  };

  ACCESSVDB_HOSTDEV DueEvaluation(const Update& update, const Tests& tests, const KnownPoint& known, std::uint32_t id)
      : update_(update), tests_(tests), known_(known), id_(id) {}

  [[nodiscard]] ACCESSVDB_HOSTDEV DueOutcome run(const Due& due) {
    DueOutcome outcome;
    outcome.label_before = update_.points.label[id_];
    if (due.kind == DueKind::Confirm) {
      confirmBest();
    } else if (due.kind == DueKind::All || !evaluateSome(due, outcome)) {
      searchAll(due, outcome);
    }
    outcome.label = update_.points.label[id_];
    outcome.score = update_.points.score[id_];
    outcome.direction = update_.points.direction[id_];
    outcome.roll = static_cast<std::uint8_t>(update_.points.rollOf(id_));
    return outcome;
  }

 private:
  /// The best direction is still the best one: nothing to test.
  ACCESSVDB_HOSTDEV void confirmBest() const {
    ScoreItem item;
    item.id = id_;
    ScoreResult result;
    result.scored = 1;
    result.score = update_.points.score[id_];
    result.direction = update_.points.direction[id_];
    result.roll = static_cast<std::uint8_t>(update_.points.rollOf(id_));
    result.reason = PointReason::None;
    updatePoint(update_.points, item, result, update_.rule);
  }

  /// What the point's levels count from.
  [[nodiscard]] ACCESSVDB_HOSTDEV int base() const {
    return baseCollisions(update_.points.label[id_] == PointLabel::Accessible, update_.points.score[id_],
                          update_.rule.collision_limit);
  }

  /// @param some  only the outcomes of the item's candidates count, not the reason if there is none
  [[nodiscard]] ACCESSVDB_HOSTDEV ScoreResult search(const ScoreItem& item, bool some, int base,
                                                     SearchNotes& notes) const {
    const float* normal_L = update_.points.normal_L + 3 * static_cast<std::size_t>(id_);
    if (normal_L[0] == 0 && normal_L[1] == 0 && normal_L[2] == 0) return {};
    const std::uint64_t* seen =
        update_.points.seen + static_cast<std::size_t>(id_) * static_cast<std::size_t>(update_.points.direction_words);
    const NotingTests<Tests> noting = {tests_, known_, update_.scale, base, notes};
    const int limit = update_.rule.collision_limit;
    DirectionMask wanted = item.candidates;
    int count = 0;
    for (int w = 0; w < kMaxDirectionWords; ++w) {
      wanted.word[w] &= w < update_.points.direction_words ? seen[w] : 0;
      for (std::uint64_t left = wanted.word[w]; left != 0 && count <= FewDirections::kMost; left &= left - 1) ++count;
    }
    if ((!some || count > FewDirections::kMost) && update_.approach.axes_xyz != nullptr) {
      SortedWalk walk(update_.approach, normal_L);
      return searchDirections(noting, limit, walk, seen, item);
    }
    if (!some || count > FewDirections::kMost) {
      DirectionWalk walk(update_.approach, normal_L, update_.nearest(update_.approach, normal_L));
      return searchDirections(noting, limit, walk, seen, item);
    }
    FewDirections walk(update_.approach, normal_L, wanted);
    return searchDirections(noting, limit, walk, seen, item);
  }

  ACCESSVDB_HOSTDEV void conclude(const ScoreItem& item, ScoreResult& result, const SearchNotes& notes, int before,
                                  DueOutcome& outcome) const {
    outcome.tests += result.tests;
    updatePoint(update_.points, item, result, update_.rule);
    learn(known_, update_.scale.levels, notes, before, base());
  }

  ACCESSVDB_HOSTDEV void searchAll(const Due& due, DueOutcome& outcome) const {
    ScoreItem item;
    item.id = id_;
    item.evidence = due.evidence;
    for (std::uint64_t& word : item.candidates.word) word = ~std::uint64_t{0};
    SearchNotes notes;
    const int before = base();
    ScoreResult result = search(item, false, before, notes);
    conclude(item, result, notes, before, outcome);
  }

  /// Evaluates a point with some directions in question. @return false if all of them are
  [[nodiscard]] ACCESSVDB_HOSTDEV bool evaluateSome(const Due& due, DueOutcome& outcome) const {
    const PointStateView& points = update_.points;
    const int limit = update_.rule.collision_limit, before = base();
    const bool accessible = points.label[id_] == PointLabel::Accessible;
    int score = limit - 1, direction = kNoDirection, roll = 0;  // of a blocked point only free directions count
    bool became_worse = false;
    if (accessible) {
      score = points.score[id_];
      direction = points.direction[id_];
      roll = points.rollOf(id_);
      if (due.test_best != 0) {
        ++outcome.tests;
        const AxisCount found = testBest(due.test_best, direction, {score, roll});
        if (found.count >= limit) return false;
        became_worse = found.count > score;
        score = found.count;
        roll = found.roll;
      }
    }
    ScoreItem item;
    item.id = id_;
    item.known_score = static_cast<std::uint16_t>(score);
    item.known_direction = static_cast<std::uint16_t>(direction);
    item.known_roll = static_cast<std::uint8_t>(roll);
    item.keep_reason = accessible ? 0 : 1;
    item.evidence = due.evidence;
    item.candidates = due.candidates;
    if (became_worse) item.candidates = askedUnlessKnownWorse(known_, update_.scale.levels, score - before);
    const bool some = any(item.candidates);
    if (accessible) item.candidates.set(direction);
    SearchNotes notes;
    ScoreResult result;
    if (some) {
      result = search(item, true, before, notes);
    } else {
      result.scored = 1;
      if (accessible) {
        result.score = static_cast<std::uint16_t>(score);
        result.direction = static_cast<std::uint16_t>(direction);
        result.roll = static_cast<std::uint8_t>(roll);
        result.reason = PointReason::None;
      }
    }
    conclude(item, result, notes, before, outcome);
    return true;
  }

  /// Tests the best direction of an accessible point again.
  /// @param stored  what is known of it
  /// @return its collisions, exact below the limit; kNoScore if its corridor is blocked
  [[nodiscard]] ACCESSVDB_HOSTDEV AxisCount testBest(std::uint8_t test_best, int direction,
                                                     const AxisCount& stored) const {
    if ((test_best & kTestArm) != 0 && tests_.arm(direction).reason != PointReason::None) return {kNoScore, 0};
    return (test_best & kTestTool) != 0 ? tests_.collisions(direction, update_.rule.collision_limit - 1) : stored;
  }

  const Update& update_;
  const Tests& tests_;
  const KnownPoint& known_;
  std::uint32_t id_;
};

}  // namespace accessvdb::kernels
