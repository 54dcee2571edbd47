// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Exact incremental updates. After every update without a backlog, the label of each point, and the best direction and
/// score of each accessible point, equal those of a full evaluation of the current map.
///
/// For each point the scheduler knows directions that are blocked under the current map, and at which stage. They need
/// no test until a flip for the better lies on a voxel that this stage reads: a corridor sample that became free for
/// those blocked in the corridor, a tool voxel that stopped colliding for those blocked by the tool. A flip for the
/// worse matters only to the one best direction of an accessible point. A changed normal or seen set only changes which
/// directions are admissible: those not known to be blocked are tested.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <iterator>
#include <vector>

#include "hostdev/direction_filter.h"
#include "launch/stopwatch.h"
#include "update/backlog.h"
#include "update/flip_set.h"
#include "update/known_blocked.h"
#include "update/leaf_footprint.h"
#include "update/make_scheduler.h"
#include "update/moved_points.h"

namespace accessvdb::internal {
namespace {

/// What is due at a point. Kept while the point waits in the backlog.
enum Due : std::uint8_t {
  kScore = 1,          ///< try the directions not known to be blocked
  kForgetBest = 2,     ///< the count of the best direction is no longer valid
  kForgetBlocked = 4,  ///< nor are the directions known to be blocked
  kEvidence = 8        ///< the point itself changed, not only the map around it
};

class ExactOnHost final : public UpdateScheduler {
 public:
  ExactOnHost(PointScorer& scorer, const kernels::ToolKernelView& tool, const kernels::ApproachView& approach)
      : scorer_(scorer),
        approach_(approach),
        footprint_(tool, approach, scorer.params().tsdf.voxel_size_m, 0),
        offset_directions_(tool, approach.num_directions, OffsetDirections::kMostBytes),
        collision_limit_(tool.collision_limit),
        all_(kernels::allDirections(approach.num_directions)),
        moved_points_(scorer) {}

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f>,
                   std::span<const Eigen::Vector3f>) override {
    moved_points_.note(touched);
  }

  void noteChanges(std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>,
                   const MapChanges& changes) override {
    if (!anything_scored_) return;  // nothing to invalidate yet
    for (const auto& part : changes.facts) flips_.add(part);
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    scorer_.grow();
    blocked_.grow(scorer_.points().size());
    backlog_.grow(scorer_.points().size());

    const std::vector<std::uint32_t> crossed = findCrossed();
    std::vector<std::uint32_t> moved;
    std::ranges::set_union(moved_points_.find(), crossed, std::back_inserter(moved));
    const std::vector<std::uint32_t> changed = scorer_.refreshNeighbourhoods(moved);
    moved_points_.refreshed(moved);
    for (const std::uint32_t id : changed) request(id, kEvidence);
    for (const std::uint32_t id : crossed) request(id, kEvidence | kForgetBlocked | kForgetBest);
    scorer_.upload(changed);  // includes those that crossed: they had no neighbourhood yet
    if (!flips_.empty()) applyFlips();
    flips_.clear();
    moved_points_.clear();

    const Backlog::Turn turn = backlog_.take(scorer_.params().update.budget_points);
    stats.dirty_points = moved.size() + turn.ids.size();
    stats.moved_points = moved.size();
    stats.backlog = backlog_.size();
    const kernels::Stopwatch scoring;
    scoreAll(turn, tables, stats);
    stats.score_ms = scoring.milliseconds();
    return stats;
  }

  std::uint64_t bytes() const override {
    return offset_directions_.bytes() + blocked_.bytes() + backlog_.bytes() + flips_.bytes() + moved_points_.bytes() +
           fresh_.capacity() * sizeof(std::uint32_t);
  }

 private:
  void request(std::uint32_t id, unsigned what) { backlog_.ask(id, static_cast<std::uint8_t>(kScore | what)); }

  /// Cause (e): points whose confidence crossed the bound. Weights only grow, so only points below it are checked.
  std::vector<std::uint32_t> findCrossed() {
    for (std::uint32_t id = known_points_; id < scorer_.points().size(); ++id) fresh_.push_back(id);
    known_points_ = scorer_.points().size();
    std::vector<std::uint32_t> crossed = scorer_.takeConfident(fresh_);
    scorer_.refreshTouched(moved_points_.touched());  // cheap compared with the rest
    return crossed;
  }

  /// Cause (a), with the sign of the flips.
  void applyFlips() {
    const PointStore& points = scorer_.points();
    const auto& blocks = points.index().blocks();
    const FreedVoxels freed(flips_);
    std::vector<std::uint8_t> wanted(points.size(), 0);
    tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) {
      const PointBlock& block = blocks[b];
      if (!moved_points_.anyIn(static_cast<std::uint32_t>(b))) return;
      thread_local FlipWindow window;
      if (!footprint_.fill(block.leaf, flips_, window)) return;
      const AffectedDirections affected = footprint_.affected(block.leaf, window);
      if (!any(affected.better_tool | affected.better_arm | affected.worse_tool | affected.worse_arm)) return;
      thread_local std::vector<Index3> freed_near;
      freed_near.clear();
      if (!offset_directions_.empty() && any(affected.better_tool)) {
        Index3 low, high;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          low[axis] = block.leaf[axis] * 8 + offset_directions_.low()[axis];
          high[axis] = block.leaf[axis] * 8 + 7 + offset_directions_.high()[axis];
        }
        freed.collect(low, high, freed_near);
      }
      for (const std::uint32_t id : block.ids) {
        const PointLabel label = scorer_.record(id).label;
        if (label == PointLabel::Unscored) continue;
        const DirectionMask better = release(id, affected, freed_near, window);
        wanted[id] = label == PointLabel::Accessible ? dueIfAccessible(id, affected, better, window)
                     : any(better)                   ? kScore
                                                     : 0;
      }
    });
    for (std::uint32_t id = 0; id < wanted.size(); ++id) {
      if (wanted[id] != 0) request(id, wanted[id]);
    }
  }

  /// Removes what flips for the better make uncertain. @return directions that may have become better
  DirectionMask release(std::uint32_t id, const AffectedDirections& affected, std::span<const Index3> freed_near,
                        const FlipWindow& flips) {
    const Eigen::Vector3f& position_L = scorer_.points().first_L(id);
    KnownBlocked& known = blocked_[id];
    DirectionMask better = {};
    if (!offset_directions_.empty()) {
      if (!freed_near.empty())
        better = known.release(scorer_.points().voxelOf(position_L), freed_near, offset_directions_);
    } else {
      forEachDirection(affected.better_tool, [&](int d) {
        if (footprint_.toolBetter(position_L, d, flips)) better.set(d);
      });
      known.tool = without(known.tool, better);
    }
    // Still blocked in the corridor: the tool does not matter yet.
    better = without(better, known.arm);
    forEachDirection(affected.better_arm & known.arm, [&](int d) {
      if (!footprint_.armBetter(position_L, d, flips)) return;
      known.arm.reset(d);
      if (!known.tool.test(d)) better.set(d);
    });
    return better;
  }

  /// @param better  directions that may have become better
  [[nodiscard]] std::uint8_t dueIfAccessible(std::uint32_t id, const AffectedDirections& affected,
                                             const DirectionMask& better, const FlipWindow& flips) const {
    const PointRecord& record = scorer_.record(id);
    const Eigen::Vector3f& position_L = scorer_.points().first_L(id);
    const int best = record.direction;
    if ((affected.worse_arm.test(best) && footprint_.armWorse(position_L, best, flips)) ||
        (affected.worse_tool.test(best) && footprint_.toolWorse(position_L, best, flips))) {
      return kScore | kForgetBest;
    }
    // If the best direction has collisions, any other may be better now; otherwise only those tried before it.
    std::uint8_t due = 0;
    forEachDirection(better & record.seen, [&](int d) {
      if (record.score > 0) due = kScore | kForgetBest;
      if (ranksBefore(d, record)) due |= kScore;
    });
    return due;
  }

  /// Is d tried before the best direction of the point?
  [[nodiscard]] bool ranksBefore(int d, const PointRecord& record) const {
    return kernels::ranksBefore(approach_, record.normal_L.data(), d, record.direction);
  }

  void scoreAll(const Backlog::Turn& turn, const ScoringTables& tables, UpdateStats& stats) {
    std::vector<kernels::ScoreItem> items;
    std::vector<PointLabel> labels_before;
    items.reserve(turn.ids.size());
    for (std::size_t n = 0; n < turn.ids.size(); ++n) {
      const std::uint32_t id = turn.ids[n];
      const std::uint8_t due = turn.asked[n];
      const PointRecord& record = scorer_.record(id);
      if (!scorer_.confidentEnough(id)) continue;
      const bool best_admissible = scorer_.admissible(id, record.direction, approach_);
      // A blocked point's reason comes from its closest direction: if that one is gone, test all of them.
      const bool reason_gone = record.label == PointLabel::Blocked && !best_admissible;
      if ((due & kForgetBlocked) != 0 || record.label == PointLabel::Unscored || reason_gone) blocked_[id] = {};
      kernels::ScoreItem item;
      item.id = id;
      item.skip = blocked_[id].arm | blocked_[id].tool;
      item.candidates = all_;
      item.keep_reason = record.label == PointLabel::Blocked && best_admissible ? 1 : 0;
      item.evidence = (due & kEvidence) != 0 ? 1 : 0;
      if (record.label == PointLabel::Accessible && (due & kForgetBest) == 0 && best_admissible) {
        item.known_direction = record.direction;
        item.known_score = record.score;
      }
      items.push_back(item);
      labels_before.push_back(record.label);
    }
    const auto take = [&](const std::vector<kernels::ScoreItem>& asked,
                          const std::vector<kernels::ScoreResult>& results) {
      for (std::size_t n = 0; n < asked.size(); ++n) {
        blocked_[asked[n].id].learn(results[n], collision_limit_);
        stats.direction_tests += results[n].tests;
        stats.scored_points += results[n].tests > 0 ? 1 : 0;
      }
    };
    const std::vector<kernels::ScoreResult> results = scorer_.score(items, tables);
    take(items, results);

    // Points that lost their access while some directions were skipped: their reason needs all directions.
    std::vector<kernels::ScoreItem> again;
    for (std::size_t n = 0; n < items.size(); ++n) {
      stats.label_changes += labels_before[n] != results[n].label ? 1 : 0;
      if (results[n].label == PointLabel::Blocked && labels_before[n] == PointLabel::Accessible &&
          results[n].skipped != 0) {
        blocked_[items[n].id] = {};
        again.push_back({});
        again.back().id = items[n].id;
        again.back().candidates = all_;
      }
    }
    if (!again.empty()) take(again, scorer_.score(again, tables));
    anything_scored_ = anything_scored_ || !items.empty();
  }

  PointScorer& scorer_;
  kernels::ApproachView approach_;
  LeafFootprint footprint_;
  OffsetDirections offset_directions_;
  std::uint16_t collision_limit_;
  DirectionMask all_;
  MovedPoints moved_points_;
  FlipSet flips_;
  std::vector<std::uint32_t> fresh_;    ///< below the confidence bound
  Backlog backlog_;                     ///< points with something due
  ChunkedArray<KnownBlocked> blocked_;  ///< by id
  std::uint32_t known_points_ = 0;
  bool anything_scored_ = false;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeExactOnHost(PointScorer& scorer, const HostTables& tables) {
  return std::make_unique<ExactOnHost>(scorer, tables.tool, tables.approach);
}

}  // namespace accessvdb::internal
