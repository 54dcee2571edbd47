// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Exact updates of a wide set of directions (hostdev/wide_search.h), in the simplest way that is right: nothing is
/// remembered of a point's directions but the best one, and a point is searched from the beginning once it changed or a
/// flip lies where any direction reads. So everything that is stored equals a full evaluation of the current map.
///
/// One case needs no search: where flips can only hurt, the best direction of an accessible point stays the best one as
/// long as it keeps its count.
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "launch/stopwatch.h"
#include "update/backlog.h"
#include "update/host_scheduler.h"
#include "update/make_scheduler.h"
#include "update/note_waiting.h"

namespace accessvdb::internal {
namespace {

/// Items and results of this many points are held at a time.
constexpr std::size_t kPointsAtOnce = 1 << 16;

/// Why a point is due.
enum DueBecause : std::uint8_t {
  kMapFlipped = 1,          ///< the map around it changed
  kPointChanged = 2,        ///< its normal or its views did
  kFlippedOnlyForWorse = 4  ///< no flip can help
};

class WideOnHost final : public HostScheduler {
 public:
  using HostScheduler::HostScheduler;

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    UpdateStats stats;
    const ScoringTables tables = tables_(mirror);
    takeChanges();
    kernels::Stopwatch scoring;
    std::vector<DuePoint> due = findDue();
    stats.moved_points = stats.dirty_points = leads() ? changes_->movedPoints() : 0;
    changes_->finish();
    if (budget_points > 0 || backlog_.size() > 0) {
      due = takeTurn(due, budget_points);
      scoring = {};  // points were only chosen so far
    }
    for (std::size_t first = 0; first < due.size(); first += kPointsAtOnce) {
      evaluate(std::span(due).subspan(first, std::min(kPointsAtOnce, due.size() - first)), tables, stats);
    }
    noteWaiting(backlog_, scorer_, stats);
    stats.score_ms = scoring.milliseconds();
    return stats;
  }

  std::uint64_t bytes() const override { return backlog_.bytes() + (leads() ? changes_->bytes() : 0); }

 private:
  struct DuePoint {
    std::uint32_t id;
    std::uint8_t asked;
  };
  struct Found {
    LeafGroupBlocks leaf_group;
    std::vector<DuePoint> due;
  };

  /// Points that changed themselves first, both by id.
  [[nodiscard]] std::vector<DuePoint> findDue() const {
    std::vector<DuePoint> all;
    if (changes_->changed().ids.empty() && changes_->flips().empty()) return all;
    tbb::enumerable_thread_specific<Found> found;
    tbb::parallel_for(std::uint32_t{0}, scorer_.points().index().leafGroups(),
                      [&](std::uint32_t leaf_group) { takeLeafGroup(leaf_group, found.local()); });
    for (const Found& part : found) all.insert(all.end(), part.due.begin(), part.due.end());
    tbb::parallel_sort(all.begin(), all.end(), [](const DuePoint& a, const DuePoint& b) {
      const bool a_itself = (a.asked & kPointChanged) != 0, b_itself = (b.asked & kPointChanged) != 0;
      return a_itself != b_itself ? a_itself : a.id < b.id;
    });
    return all;
  }

  void takeLeafGroup(std::uint32_t leaf_group, Found& found) const {
    if (!findBlocks(leaf_group, found.leaf_group)) return;
    for (const std::uint32_t b : found.leaf_group.blocks) takeBlock(b, found);
  }

  void takeBlock(std::uint32_t b, Found& found) const {
    const PointBlock& block = scorer_.points().index().blocks()[b];
    const FlipsRead read = found.leaf_group.flipped ? flipsRead(block.leaf, found.leaf_group.flips) : FlipsRead{};
    for (const std::uint32_t id : block.ids) {
      const bool changed = changes_->indexOf(id) != kNone;
      const bool scored = scorer_.record(id).label != PointLabel::Unscored;
      int asked = changed ? kPointChanged : 0;
      if (scored && read.any) asked |= kMapFlipped;
      if (asked == kMapFlipped && !read.better) asked |= kFlippedOnlyForWorse;
      if (asked != 0) found.due.push_back({id, static_cast<std::uint8_t>(asked)});
    }
  }

  /// What flipped where directions of a block's points read.
  struct FlipsRead {
    bool any = false, better = false;  ///< better: it may help one of them
  };
  [[nodiscard]] FlipsRead flipsRead(const Index3& leaf, const FlipColumns& flips) const {
    const auto kindsOf = [&](std::span<const kernels::FootprintColumn> columns, int better) {
      int kinds = 0;
      for (const kernels::FootprintColumn& column : columns) {
        const std::int32_t x = leaf[0] + column.dx, y = leaf[1] + column.dy;
        if (!flips.anyIn(x, y)) continue;
        kinds |= flips.kindsIn(x, y, leaf[2] + column.z_low, leaf[2] + column.z_high);
        if ((kinds & better) != 0) break;  // the rest can say no more
      }
      return kinds;
    };
    const int opens = bitOf(FlipKind::CollidesOff), clears = bitOf(FlipKind::ArmFreeOn);
    // A corridor that stays blocked may be blocked for another reason: collisions count there, too.
    const int arm = kindsOf(footprint_.armColumns(), clears);
    if ((arm & clears) != 0) return {true, true};
    const int tool = kindsOf(footprint_.toolColumns(), opens) & (opens | bitOf(FlipKind::CollidesOn));
    return {(tool | arm) != 0, (tool & opens) != 0};
  }

  /// Those whose turn has come, of all that wait. What happened while they waited is not known any more.
  [[nodiscard]] std::vector<DuePoint> takeTurn(const std::vector<DuePoint>& due, int budget_points) {
    backlog_.grow(scorer_.points().size());
    for (const DuePoint& point : due) {
      backlog_.ask(point.id, static_cast<std::uint8_t>(point.asked & ~kFlippedOnlyForWorse));
    }
    const Backlog::Turn turn = backlog_.take(budget_points);
    std::vector<DuePoint> taken;
    for (std::size_t n = 0; n < turn.ids.size(); ++n) taken.push_back({turn.ids[n], turn.asked[n]});
    return taken;
  }

  void evaluate(std::span<const DuePoint> due, const ScoringTables& tables, UpdateStats& stats) {
    std::vector<kernels::ScoreItem> items(due.size());
    std::vector<PointLabel> before(due.size());
    for (std::size_t n = 0; n < due.size(); ++n) {
      const PointRecord& record = scorer_.record(due[n].id);
      before[n] = record.label;
      items[n].id = due[n].id;
      items[n].evidence = (due[n].asked & kPointChanged) != 0 ? 1 : 0;
      if ((due[n].asked & kFlippedOnlyForWorse) == 0 || record.label != PointLabel::Accessible) continue;
      items[n].only_direction = record.direction;
      items[n].known_score = record.score;
      items[n].or_all = 1;
    }
    const std::vector<kernels::ScoreResult> results = scorer_.score(items, tables);
    stats.dirty_points += due.size();
    for (std::size_t n = 0; n < due.size(); ++n) {
      stats.direction_tests += results[n].tests;
      stats.scored_points += results[n].tests > 0 ? 1 : 0;
      stats.label_changes += results[n].label != before[n] ? 1 : 0;
    }
  }

  Backlog backlog_;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeWideOnHost(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes) {
  return std::make_unique<WideOnHost>(tool, std::move(changes));
}

}  // namespace accessvdb::internal
