// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the rule calls due is enough: evaluating only that gives what evaluating every direction gives. The oracle
/// counts all directions of a point before and after random changes of its normal, its seen directions and the map.
#include "hostdev/due_rule.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace accessvdb {
namespace {

using namespace kernels;

constexpr int kDirections = 100;  // more than one word of a mask
constexpr int kLimit = 4;

/// What the map says about one point: collisions of the tool, and whether the corridor is free.
struct Facts {
  std::array<int, kDirections> collisions = {};
  std::array<bool, kDirections> arm_free = {};
};

class World {
 public:
  explicit World(unsigned seed) : random_(seed) {
    for (int d = 0; d < kDirections; ++d) {
      const double yaw = 2 * std::numbers::pi * d / kDirections;
      xy_.push_back(static_cast<float>(std::cos(yaw)));
      xy_.push_back(static_cast<float>(std::sin(yaw)));
    }
    approach_.direction_xy = xy_.data();
    approach_.num_directions = kDirections;
    approach_.normal_cos_min = 0.5f;
  }

  [[nodiscard]] const ApproachView& approach() const { return approach_; }
  bool chance(double p) { return std::bernoulli_distribution(p)(random_); }

  PointDirections directions() {
    PointDirections made = {};
    if (chance(0.95)) {
      const float yaw = std::uniform_real_distribution<float>(-3.1f, 3.1f)(random_);
      made.normal[0] = std::cos(yaw);
      made.normal[1] = std::sin(yaw);
    }
    const double seen = chance(0.2) ? 0.05 : 0.7;
    for (int d = 0; d < kDirections; ++d) {
      if (chance(seen)) made.seen.set(d);
    }
    return made;
  }
  /// The same with a slightly different normal, or a few more seen directions.
  PointDirections nudged(const PointDirections& before) {
    PointDirections now = before;
    if (chance(0.5)) {
      const float turn = std::uniform_real_distribution<float>(-0.2f, 0.2f)(random_);
      now.normal[0] = before.normal[0] * std::cos(turn) - before.normal[1] * std::sin(turn);
      now.normal[1] = before.normal[0] * std::sin(turn) + before.normal[1] * std::cos(turn);
    }
    for (int d = 0; d < kDirections; ++d) {
      if (chance(0.02)) now.seen.set(d);
    }
    return now;
  }

  Facts facts() {
    Facts made;
    const int most = chance(0.5) ? 12 : 5;
    for (std::size_t d = 0; d < kDirections; ++d) {
      made.collisions.at(d) = std::uniform_int_distribution<int>(0, most)(random_);
      made.arm_free.at(d) = chance(0.6);
    }
    return made;
  }
  Facts flipped(const Facts& before) {
    Facts now = before;
    const double share = chance(0.5) ? 0.02 : 0.2;
    for (std::size_t d = 0; d < kDirections; ++d) {
      if (chance(share)) now.collisions.at(d) = std::uniform_int_distribution<int>(0, 12)(random_);
      if (chance(share)) now.arm_free.at(d) = chance(0.5);
    }
    return now;
  }

  [[nodiscard]] float cosine(const PointDirections& point, int d) const {
    const auto at = static_cast<std::size_t>(2 * d);
    return xy_[at] * point.normal[0] + xy_[at + 1] * point.normal[1];
  }
  [[nodiscard]] bool admits(const PointDirections& point, int d) const {
    const bool normal = point.normal[0] != 0 || point.normal[1] != 0;
    return normal && point.seen.test(d) && cosine(point, d) >= approach_.normal_cos_min;
  }

  /// Evaluates the directions that `asked` holds, together with one that is known.
  [[nodiscard]] StoredScore evaluate(const PointDirections& point, const Facts& facts, const DirectionMask& asked,
                                     StoredScore known = {PointLabel::Blocked, kNoDirection, kNoScore}) const {
    StoredScore best = known;
    for (int d = 0; d < kDirections; ++d) {
      const auto at = static_cast<std::size_t>(d);
      if (!asked.test(d) || !admits(point, d)) continue;
      const int score = facts.arm_free.at(at) ? facts.collisions.at(at) : kNoScore;
      const bool is_better = best.direction == kNoDirection || score < best.score ||
                             (score == best.score && cosine(point, d) > cosine(point, best.direction));
      if (is_better) best = {PointLabel::Blocked, d, score};
    }
    best.label = best.score < kLimit ? PointLabel::Accessible : PointLabel::Blocked;
    return best;
  }

 private:
  std::mt19937 random_;
  std::vector<float> xy_;
  ApproachView approach_;
};

DirectionMask all() {
  DirectionMask mask = {};
  for (int d = 0; d < kDirections; ++d) mask.set(d);
  return mask;
}

/// What flips say, and what is remembered: sometimes more than what happened, never less; known only where it is true.
/// Half of the worlds remember bounds that follow flips, the others which directions are worse than what was stored.
class Remembered {
 public:
  Remembered(World& world, const Facts& before, const Facts& now, const StoredScore& stored)
      : now_(now), follows_(world.chance(0.5)) {
    const bool arm_blocked =
        stored.label == PointLabel::Accessible && !now.arm_free.at(static_cast<std::size_t>(stored.direction));
    best_arm_blocked_ = arm_blocked || world.chance(0.5);
    const int base = stored.label == PointLabel::Accessible ? stored.score : kLimit - 1;
    for (int d = 0; d < kDirections; ++d) {
      const auto at = static_cast<std::size_t>(d);
      const auto mark = [&](DirectionMask& mask, bool happened) {
        if (happened || world.chance(0.05)) mask.set(d);
      };
      mark(masks_.better_tool, now.collisions.at(at) < before.collisions.at(at));
      mark(masks_.worse_tool, now.collisions.at(at) > before.collisions.at(at));
      mark(masks_.better_arm, now.arm_free.at(at) && !before.arm_free.at(at));
      mark(masks_.worse_arm, !now.arm_free.at(at) && before.arm_free.at(at));
      const bool is_worse = !now.arm_free.at(at) || now.collisions.at(at) > base;
      if (is_worse && world.chance(0.5)) worse_.set(d);
      if (!now.arm_free.at(at) && world.chance(0.5)) blocked_.set(d);
      if (world.chance(0.5)) least_.at(at) = std::max(0, now.collisions.at(at) - (world.chance(0.5) ? 0 : 3));
    }
  }
  [[nodiscard]] GroupMasks masks() const { return masks_; }
  [[nodiscard]] std::uint64_t notKnownWorse(int w, std::uint64_t asked, int most) const {
    if (!follows_) return asked & ~worse_.word[w];
    DirectionMask worse = blocked_;
    for (int d = 0; d < kDirections; ++d) {
      if (least_.at(static_cast<std::size_t>(d)) > most) worse.set(d);
    }
    return asked & ~worse.word[w];
  }
  [[nodiscard]] int collisionsOf(int d) const {
    return follows_ ? now_.collisions.at(static_cast<std::size_t>(d)) : int{kNoScore};
  }
  [[nodiscard]] bool bestArmMayBeBlocked() const { return best_arm_blocked_; }
  [[nodiscard]] static int limit() { return kLimit; }

 private:
  GroupMasks masks_ = {};
  DirectionMask worse_ = {}, blocked_ = {};
  std::array<int, kDirections> least_ = {};
  const Facts& now_;
  bool follows_, best_arm_blocked_ = true;
};

/// What is stored after evaluating no more than what is due.
StoredScore evaluateDue(const World& world, const PointDirections& now, const Facts& facts, const StoredScore& stored,
                        const Due& due) {
  if (due.kind == DueKind::Nothing) return stored;
  StoredScore best = stored;
  if (due.best_score != kNoScore) best.score = due.best_score;
  if (due.kind == DueKind::Confirm) return best;
  if (due.kind == DueKind::All) return world.evaluate(now, facts, all());
  if (stored.label != PointLabel::Accessible) {
    const StoredScore found = world.evaluate(now, facts, due.candidates);
    return found.label == PointLabel::Accessible ? found : stored;
  }
  const auto at = static_cast<std::size_t>(stored.direction);
  const int known = best.score;
  if ((due.test_best & kTestTool) != 0) best.score = facts.collisions.at(at);
  if ((due.test_best & kTestArm) != 0 && !facts.arm_free.at(at)) best.score = kNoScore;
  if (best.score > known || best.score >= kLimit) return world.evaluate(now, facts, all());  // others may be the best
  return world.evaluate(now, facts, due.candidates, best);
}

void expectTheSame(const StoredScore& found, const StoredScore& wanted) {
  ASSERT_EQ(found.label, wanted.label);
  if (wanted.label != PointLabel::Accessible) return;  // which direction a blocked point names is the search's business
  ASSERT_EQ(found.direction, wanted.direction);
  ASSERT_EQ(found.score, wanted.score);
}

TEST(DueRule, EvaluatingWhatIsDueAfterAChangeIsEnough) {
  std::array<int, 4> kinds = {};
  long candidates = 0, admissible = 0;
  for (unsigned seed = 0; seed < 20'000; ++seed) {
    World world(seed);
    const bool changed = world.chance(0.5), flips = world.chance(0.8);
    const PointDirections before = world.directions(), now = changed ? world.nudged(before) : before;
    const Facts facts_before = world.facts(), facts = flips ? world.flipped(facts_before) : facts_before;
    const StoredScore stored = world.evaluate(before, facts_before, all());
    const Remembered remembered(world, facts_before, facts, stored);
    const PointNow point = {world.approach(), stored, now};
    const Due due = dueAfterChange(point, before, changed, remembered);
    ASSERT_EQ(due.evidence != 0, changed) << seed;
    ASSERT_NO_FATAL_FAILURE(
        expectTheSame(evaluateDue(world, now, facts, stored, due), world.evaluate(now, facts, all())))
        << "seed " << seed;
    ++kinds.at(static_cast<std::size_t>(due.kind));
    if (due.kind != DueKind::Some) continue;
    for (int d = 0; d < kDirections; ++d) {
      candidates += due.candidates.test(d) ? 1 : 0;
      admissible += world.admits(now, d) ? 1 : 0;
      ASSERT_TRUE(world.admits(now, d) || !due.candidates.test(d)) << seed;
    }
  }
  for (const int kind : kinds) EXPECT_GT(kind, 300);
  EXPECT_LT(3 * candidates, admissible) << "it is to spare most directions";
}

TEST(DueRule, EvaluatingWhatIsDueAfterWaitingIsEnough) {
  std::array<int, 4> kinds = {};
  for (unsigned seed = 0; seed < 20'000; ++seed) {
    World world(seed);
    const PointDirections before = world.directions();
    PointDirections now = before;
    const Facts facts_before = world.facts();
    Facts facts = facts_before;
    const StoredScore stored = world.evaluate(before, facts_before, all());
    for (int frame = 0; frame < 3; ++frame) {
      now = world.nudged(now);
      facts = world.flipped(facts);
    }
    const Remembered remembered(world, facts_before, facts, stored);
    const PointNow point = {world.approach(), stored, now};
    const Due due = dueAfterWaiting(point, seed % 2 == 0, remembered);
    ASSERT_EQ(due.evidence != 0, seed % 2 == 0);
    ASSERT_NO_FATAL_FAILURE(
        expectTheSame(evaluateDue(world, now, facts, stored, due), world.evaluate(now, facts, all())))
        << "seed " << seed;
    ++kinds.at(static_cast<std::size_t>(due.kind));
  }
  EXPECT_GT(kinds.at(static_cast<std::size_t>(DueKind::Some)), 5000);
  EXPECT_GT(kinds.at(static_cast<std::size_t>(DueKind::All)), 300);
}

/// A point that has never been scored is tried in all directions once it changes, and not before.
TEST(DueRule, UnscoredPointsWaitForTheirNeighbourhood) {
  World world(7);
  const PointDirections now = world.directions();
  const Facts facts = world.facts();
  const StoredScore unscored = {PointLabel::Unscored, kNoDirection, kNoScore};
  const Remembered remembered(world, facts, facts, unscored);
  const PointNow point = {world.approach(), unscored, now};
  EXPECT_EQ(dueAfterChange(point, now, false, remembered).kind, DueKind::Nothing);
  EXPECT_EQ(dueAfterChange(point, now, true, remembered).kind, DueKind::All);
  EXPECT_EQ(dueAfterWaiting(point, true, remembered).kind, DueKind::All);
}

/// A best direction without collisions cannot improve, but an earlier roll may come to have none either.
TEST(DueRule, TheBestDirectionIsCountedAgainWhereAnEarlierRollMayBecomeAsGood) {
  struct Freed {
    GroupMasks freed;
    [[nodiscard]] const GroupMasks& masks() const { return freed; }
    [[nodiscard]] std::uint64_t notKnownWorse(int, std::uint64_t asked, int) const { return asked; }
    [[nodiscard]] int collisionsOf(int) const { return kNoScore; }
    [[nodiscard]] bool bestArmMayBeBlocked() const { return true; }
    [[nodiscard]] int limit() const { return kLimit; }
  };
  World world(8);
  PointDirections now = {};
  now.normal[0] = 1;
  now.seen.set(0);
  Freed freed = {};
  freed.freed.better_tool.set(0);
  const auto dueAt = [&](int score, int roll) {
    return dueAfterChange({world.approach(), {PointLabel::Accessible, 0, score, roll}, now}, now, false, freed);
  };
  EXPECT_EQ(dueAt(0, 0).kind, DueKind::Nothing);
  EXPECT_EQ(dueAt(0, 2).kind, DueKind::Some);
  EXPECT_EQ(dueAt(0, 2).test_best, kTestTool);
  EXPECT_EQ(dueAt(1, 0).test_best, kTestTool);
}

}  // namespace
}  // namespace accessvdb
