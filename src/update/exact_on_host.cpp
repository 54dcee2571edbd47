// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Exact incremental updates. After every update without a backlog, the label of each point, and the best direction and
/// score of each accessible point, equal those of a full evaluation of the current map.
///
/// The rules are those of a GPU: what is due at a point (hostdev/due_rule.h), how it is evaluated
/// (hostdev/due_evaluation.h), and what is remembered about its other directions (hostdev/known_levels.h). Here they
/// run block by block.
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <iterator>
#include <span>
#include <vector>

#include "launch/stopwatch.h"
#include "processor/prefetch.h"
#include "update/backlog.h"
#include "update/corridor_offsets.h"
#include "update/host_scheduler.h"
#include "update/known_directions.h"
#include "update/make_scheduler.h"
#include "update/note_waiting.h"

namespace accessvdb::internal {
namespace {

constexpr std::size_t kDuePerTask = 256;
/// How many points ahead of the current one are prefetched.
constexpr std::size_t kPointsAhead = 6;

/// What a point waits for in the backlog. What is due is decided when its turn comes.
enum Asked : std::uint8_t {
  kAsked = 1,
  kAskedByItself = 2  ///< the point itself changed, not only the map around it
};

class ExactOnHost final : public HostScheduler {
 public:
  /// @param changes  possibly shared with the schedulers of other tools
  ExactOnHost(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes)
      : HostScheduler(tool, std::move(changes)),
        approach_(tool.host.approach),
        all_directions_(kernels::allDirections(approach_.num_directions)),
        limit_(tool.host.tool.collision_limit),
        corridors_(approach_, scorer_.params().tsdf.voxel_size_m),
        known_(tool.host.tool, approach_.num_directions, approach_.axes_xyz != nullptr) {}

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    UpdateStats stats;
    waits_ = budget_points > 0 || backlog_.size() > 0;
    takeChanges();
    makeRoom();
    kernels::Stopwatch scoring;
    const auto evaluator = scorer_.backend().makeDueEvaluator(scorer_.dueUpdate(known_.scale(), tables_(mirror)));
    FoundByThread found;
    takeAllDue({changes_->changed(), *evaluator}, found);
    if (waits_) {
      scoring = {};  // points were only chosen so far
      takeTurn(budget_points, *evaluator, found);
    }
    stats.moved_points = stats.dirty_points = leads() ? changes_->movedPoints() : 0;
    stats.score_ms = scoring.milliseconds();
    changes_->finish();
    for (const Found& part : found) {
      stats.dirty_points += part.stats.dirty_points;
      stats.direction_tests += part.stats.direction_tests;
      stats.scored_points += part.stats.scored_points;
      stats.label_changes += part.stats.label_changes;
    }
    noteWaiting(backlog_, scorer_, stats);
    return stats;
  }

  std::uint64_t bytes() const override {
    return known_.bytes() + corridors_.bytes() + backlog_.bytes() + (leads() ? changes_->bytes() : 0);
  }

 private:
  /// A point to append to the backlog.
  struct Ask {
    std::uint32_t id;
    std::uint8_t what;
    bool by_itself;  ///< asked for before those that only flips concern
  };
  /// A column of voxels, from the lowest one of a block.
  struct Column {
    std::int16_t dx, dy;
  };
  /// A block of points in which something may be due.
  struct DueBlock {
    std::uint32_t block;
    bool changed;  ///< points of it
    bool flipped;  ///< the map, for some of its directions
    AffectedDirections affected;
  };
  /// What one thread found, and its scratch memory.
  struct Found {
    LeafGroupBlocks leaf_group;
    std::vector<DueBlock> due;
    std::array<std::vector<Column>, 8> freed_at;  ///< by height in the block: voxels that became free for a corridor
    std::vector<kernels::DueTask> tasks;
    std::vector<kernels::DueOutcome> outcomes;
    std::vector<Ask> asks;
    UpdateStats stats;
  };
  using FoundByThread = tbb::enumerable_thread_specific<Found>;
  /// What the threads work on.
  struct Work {
    const PointScorer::Changed& changed;
    kernels::DueEvaluator& evaluator;
  };

  /// What flips mean for a point; read only if the rule asks.
  struct FlipsOfPoint {
    const KnownDirections::LowestLevels& lowest;
    const kernels::KnownPoint& known;
    const kernels::GroupMasks& masks_;
    int collision_limit;

    [[nodiscard]] const kernels::GroupMasks& masks() const { return masks_; }
    [[nodiscard]] std::uint64_t notKnownWorse(int w, std::uint64_t asked, int /*most*/) const {
      return KnownDirections::notKnownWorse(known, lowest, w, asked);
    }
    [[nodiscard]] int collisionsOf(int /*direction*/) const { return kNoScore; }
    [[nodiscard]] bool bestArmMayBeBlocked() const { return true; }
    [[nodiscard]] int limit() const { return collision_limit; }
  };

  void makeRoom() {
    const std::uint32_t points = scorer_.points().size();
    known_.grow(points, scorer_.points().index().blocks().size());
    backlog_.grow(points);
  }

  [[nodiscard]] kernels::PointDirections directionsOf(std::uint32_t id) const {
    const PointRecord& record = scorer_.record(id);
    return {{record.normal_L.x(), record.normal_L.y(), record.normal_L.z()}, record.seen};
  }
  /// Corridors of points that are not scored are not followed, so of a point that is scored again none is known.
  [[nodiscard]] kernels::KnownPoint knownOf(std::uint32_t id, std::uint32_t block) {
    if (scorer_.record(id).label == PointLabel::Unscored) {
      known_.forgetCorridors(id, all_directions_);
    }
    return known_.of(id, block);
  }
  [[nodiscard]] kernels::StoredScore storedScore(std::uint32_t id) const {
    const PointRecord& record = scorer_.record(id);
    return {record.label, record.direction, record.score, record.roll};
  }

  /// Evaluates everything that is due, leaf group by leaf group, except what has to wait: that goes to the backlog.
  void takeAllDue(const Work& work, FoundByThread& found) {
    const SurfaceIndex& index = scorer_.points().index();
    if (!work.changed.ids.empty() || !changes_->flips().empty()) {
      tbb::parallel_for(std::uint32_t{0}, index.leafGroups(),
                        [&](std::uint32_t leaf_group) { takeLeafGroup(leaf_group, work, found.local()); });
    }
    if (waits_) askInOrder(found);
  }

  void takeLeafGroup(std::uint32_t leaf_group, const Work& work, Found& found) {
    if (!findBlocks(leaf_group, found.leaf_group)) return;
    listDue(found);
    // The ids of a block and what is known of its points are scattered in memory. So they are prefetched in steps: the
    // ids two blocks ahead, the first points one block ahead.
    const ChunkedArray<PointBlock>& blocks = scorer_.points().index().blocks();
    const std::vector<DueBlock>& due = found.due;
    const auto prefetchIds = [&](std::size_t n) {
      if (n < due.size()) prefetchRead(blocks[due[n].block].ids.data());
    };
    const auto prefetchPoints = [&](std::size_t n) {
      if (n >= due.size()) return;
      const std::span<const std::uint32_t> ids = blocks[due[n].block].ids;
      for (const std::uint32_t id : ids.first(std::min(ids.size(), kPointsAhead))) prefetchPoint(id, due[n].changed);
    };
    prefetchIds(0);
    prefetchIds(1);
    prefetchPoints(0);
    for (std::size_t n = 0; n < due.size(); ++n) {
      prefetchIds(n + 2);
      prefetchPoints(n + 1);
      takeBlock(due[n], work.changed, found);
    }
    evaluate(work.evaluator, found);
  }

  /// Lists the blocks of a leaf group in which something may be due.
  void listDue(Found& found) const {
    found.due.clear();
    for (const std::uint32_t b : found.leaf_group.blocks) {
      const Index3& leaf = scorer_.points().index().blocks()[b].leaf;
      DueBlock due = {b, changes_->changedIn(b), false, {}};
      if (found.leaf_group.flipped) due.affected = footprint_.affected(leaf, found.leaf_group.flips);
      const AffectedDirections& by = due.affected;
      due.flipped = any(by.better_tool | by.better_arm | by.worse_tool | by.worse_arm);
      if (due.changed || due.flipped) found.due.push_back(due);
    }
  }

  void prefetchPoint(std::uint32_t id, bool changed) {
    prefetchRead(&scorer_.record(id));
    if (changed) changes_->prefetch(id);
    known_.prefetch(id);
  }

  void takeBlock(const DueBlock& due, const PointScorer::Changed& changed, Found& found) {
    const std::uint32_t b = due.block;
    const PointBlock& block = scorer_.points().index().blocks()[b];
    const AffectedDirections& affected = due.affected;
    if (any(affected.better_tool)) {
      FreedVoxels freed;
      countFreed(block.leaf, found.leaf_group.flips, freed);
      known_.age(b, block.ids, freed, affected.better_tool);
    }
    const bool corridors = any(affected.better_arm), one_by_one = corridors && listFreed(block, found);
    kernels::GroupMasks masks = affected;
    const KnownDirections::LowestLevels lowest = known_.lowestWithMore(b);
    std::size_t n = 0;
    for (std::size_t word = 0; word < 8; ++word) {
      for (std::uint64_t bits = block.occupied[word]; bits != 0; bits &= bits - 1, ++n) {
        if (n + kPointsAhead < block.ids.size()) prefetchPoint(block.ids[n + kPointsAhead], due.changed);
        const std::uint32_t id = block.ids[n], entry = due.changed ? changes_->indexOf(id) : kNone;
        const bool scored = scorer_.record(id).label != PointLabel::Unscored;
        if (scored && corridors) {
          if (one_by_one) masks.better_arm = freedFor(static_cast<int>(word), std::countr_zero(bits), found);
          known_.forgetCorridors(id, masks.better_arm);
        }
        if (entry != kNone) {
          takePoint({id, b, &changed.before[entry], masks, lowest}, found);
        } else if (scored && due.flipped) {
          takePoint({id, b, nullptr, masks, lowest}, found);
        }
      }
    }
  }

  /// Lists the voxels near a block that became free for a corridor. @return false if there are too many
  bool listFreed(const PointBlock& block, Found& found) const {
    constexpr std::size_t kMostPairs = 1 << 15;  // of a voxel and a point
    if (corridors_.empty()) return false;
    for (std::vector<Column>& columns : found.freed_at) columns.clear();
    std::size_t listed = 0;
    for (const kernels::FootprintColumn& column : footprint_.armColumns()) {
      const std::int32_t z = block.leaf[2];  // corridors stay at the height of the point
      if (z + column.z_low > z || z + column.z_high < z) continue;
      found.leaf_group.flips.forEach(block.leaf[0] + column.dx, block.leaf[1] + column.dy, z, z, FlipKind::ArmFreeOn,
                                     [&](std::int32_t, std::uint32_t change) {
                                       const LeafBits& freed = changes_->flips().changes()[change].arm_free_on;
                                       for (int x = 0; x < 8; ++x) {
                                         for (std::uint64_t bits = freed[static_cast<std::size_t>(x)]; bits != 0;
                                              bits &= bits - 1) {
                                           const int yz = std::countr_zero(bits);
                                           found.freed_at[static_cast<std::size_t>(yz & 7)].push_back(
                                               {static_cast<std::int16_t>(8 * column.dx + x),
                                                static_cast<std::int16_t>(8 * column.dy + (yz >> 3))});
                                           ++listed;
                                         }
                                       }
                                     });
      if (listed * block.ids.size() > 8 * kMostPairs) return false;
    }
    return true;
  }
  /// Directions whose corridor may have become free for the point in a voxel of the block.
  [[nodiscard]] DirectionMask freedFor(int x, int yz, const Found& found) const {
    DirectionMask better = {};
    for (const Column& column : found.freed_at[static_cast<std::size_t>(yz & 7)]) {
      const DirectionMask* directions = corridors_.at(column.dx - x, column.dy - (yz >> 3));
      if (directions != nullptr) better = better | *directions;
    }
    return better;
  }

  void countFreed(const Index3& leaf, const FlipColumns& flips, FreedVoxels& freed) const {
    if (known_.cells().empty()) return;
    for (const LeafFootprint::Stack& stack : footprint_.toolStacks()) {
      const kernels::FootprintColumn& column = footprint_.toolColumns()[stack.begin];
      const std::int32_t x = leaf[0] + column.dx, y = leaf[1] + column.dy;
      const std::int32_t z_low = leaf[2] + column.z_low,
                         z_high = leaf[2] + footprint_.toolColumns()[stack.end - 1].z_high;
      if ((flips.kindsIn(x, y, z_low, z_high) & bitOf(FlipKind::CollidesOff)) == 0) continue;
      flips.forEach(x, y, z_low, z_high, FlipKind::CollidesOff, [&](std::int32_t z, std::uint32_t change) {
        freed.add(known_.cells(), approach_.num_directions, {column.dx, column.dy, z - leaf[2]},
                  changes_->freed()[change]);
      });
    }
  }

  /// A point that may have something due.
  struct Candidate {
    std::uint32_t id, block;
    const kernels::PointDirections* before;  ///< its directions at the last update; null: they did not change
    const kernels::GroupMasks& masks;
    const KnownDirections::LowestLevels& lowest;  ///< of its block
  };
  void takePoint(const Candidate& candidate, Found& found) {
    const std::uint32_t id = candidate.id;
    const bool changed = candidate.before != nullptr;
    if (waits_ && backlog_.holds(id)) {
      if (changed) found.asks.push_back({id, kAskedByItself, true});
      return;
    }
    const kernels::KnownPoint known = knownOf(id, candidate.block);
    const kernels::PointDirections now = directionsOf(id);
    const kernels::PointNow point = {approach_, storedScore(id), now};
    const FlipsOfPoint flips = {candidate.lowest, known, candidate.masks, limit_};
    const kernels::Due due = kernels::dueAfterChange(point, changed ? *candidate.before : now, changed, flips);
    if (due.kind == kernels::DueKind::Nothing) return;
    if (due.kind == kernels::DueKind::Confirm || !waits_) {
      found.tasks.push_back({id, due, known});
    } else {
      found.asks.push_back({id, static_cast<std::uint8_t>(changed ? kAsked | kAskedByItself : kAsked), changed});
    }
  }

  void evaluate(kernels::DueEvaluator& evaluator, Found& found) {
    found.outcomes.resize(found.tasks.size());
    evaluator.evaluate(found.tasks.data(), found.outcomes.data(), found.tasks.size());
    for (std::size_t n = 0; n < found.tasks.size(); ++n) {
      const kernels::DueOutcome& outcome = found.outcomes[n];
      scorer_.store(found.tasks[n].id, outcome);
      found.stats.direction_tests += outcome.tests;
      found.stats.scored_points += outcome.tests > 0 ? 1 : 0;
      found.stats.label_changes += outcome.label != outcome.label_before ? 1 : 0;
    }
    found.stats.dirty_points += found.tasks.size();
    found.tasks.clear();
  }

  /// Hands what the threads found to the backlog: points that changed themselves first, both by id.
  void askInOrder(FoundByThread& found) {
    std::vector<Ask> asks;
    for (Found& part : found) {
      asks.insert(asks.end(), part.asks.begin(), part.asks.end());
      part.asks.clear();
    }
    tbb::parallel_sort(asks.begin(), asks.end(), [](const Ask& a, const Ask& b) {
      return a.by_itself != b.by_itself ? a.by_itself : a.id < b.id;
    });
    for (const Ask& ask : asks) backlog_.ask(ask.id, ask.what);
  }

  /// Evaluates the points whose turn has come.
  void takeTurn(int budget_points, kernels::DueEvaluator& evaluator, FoundByThread& found) {
    const PointStore& points = scorer_.points();
    const Backlog::Turn turn = backlog_.take(budget_points);
    std::vector<std::uint32_t> order(turn.ids.size());
    for (std::uint32_t n = 0; n < order.size(); ++n) order[n] = n;
    tbb::parallel_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
      const std::uint32_t block_a = points.blockOf(turn.ids[a]), block_b = points.blockOf(turn.ids[b]);
      return block_a != block_b ? block_a < block_b : turn.ids[a] < turn.ids[b];
    });
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, order.size(), kDuePerTask), [&](const auto& range) {
      Found& mine = found.local();
      const kernels::GroupMasks no_masks = {};  // the rule asks for none
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const std::uint32_t id = turn.ids[order[n]];
        const std::uint32_t block = points.blockOf(id);
        const kernels::KnownPoint known = knownOf(id, block);
        const KnownDirections::LowestLevels lowest = known_.lowestWithMore(block);
        const kernels::PointDirections now = directionsOf(id);
        const kernels::PointNow point = {approach_, storedScore(id), now};
        const FlipsOfPoint flips = {lowest, known, no_masks, limit_};
        const bool evidence = (turn.asked[order[n]] & kAskedByItself) != 0;
        mine.tasks.push_back({id, kernels::dueAfterWaiting(point, evidence, flips), known});
      }
      evaluate(evaluator, mine);
    });
  }

  kernels::ApproachView approach_;
  DirectionMask all_directions_;
  int limit_;  ///< [n_c]
  CorridorOffsets corridors_;
  KnownDirections known_;
  bool waits_ = false;  ///< this update has a budget, or the one before left points
  Backlog backlog_;     ///< points with something due
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeExactOnHost(const ScheduledTool& tool, std::shared_ptr<ScanChanges> changes) {
  if (!changes) changes = std::make_shared<ScanChanges>(tool.scorer);
  if (kernels::isWide(tool.host.approach.num_directions)) return makeWideOnHost(tool, std::move(changes));
  return std::make_unique<ExactOnHost>(tool, std::move(changes));
}

}  // namespace accessvdb::internal
