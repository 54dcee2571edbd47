// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's incremental updates: new points, three triggers, a budget, a backlog (paper, "Incremental Updates and
/// Confidence"; docs/PAPER_MAP.md, "Update policy"). Labels are not those of a full evaluation; they approach them.
///
/// A point enters the queue once its confidence allows a score, and again when a trigger requests it. Points that one
/// update enqueues are ordered by reason, ascending within each: newly confident, (i), (ii), (iii).
///
/// The paper adapts its budget to the time taken by the last frame, which makes results depend on the machine and its
/// load. Here each update is given one, so that runs are repeatable; only a LiveSession follows the clock, and says
/// which budgets it used. There is no sliding window: the map keeps everything.
#include <algorithm>
#include <vector>

#include "launch/stopwatch.h"
#include "update/backlog.h"
#include "update/coarse_to_fine.h"
#include "update/id_list.h"
#include "update/make_scheduler.h"
#include "update/note_waiting.h"
#include "update/paper_triggers.h"

namespace accessvdb::internal {
namespace {

class PaperOnHost final : public UpdateScheduler {
 public:
  explicit PaperOnHost(const ScheduledTool& tool)
      : scorer_(tool.scorer),
        tables_(tool.tables),
        triggers_(scorer_),
        directions_(scorer_, tool.host.tool.collision_limit) {}

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f>,
                   std::span<const Eigen::Vector3f>) override {
    touched_.add(touched.all);
  }

  Needs needs() const override { return {.distances = true}; }
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override {
    triggers_.note(p_L, q_L, changes.distances);
  }

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    UpdateStats stats;
    scorer_.grow();
    enqueueAll();
    scorer_.refreshTouched(touched_.take());
    const std::vector<std::uint32_t> work = backlog_.take(budget_points).ids;
    stats.dirty_points = stats.moved_points = work.size();
    scorer_.refreshNeighbourhoods(work);
    scorer_.upload(work);
    std::vector<kernels::ScoreItem> items(work.size());
    std::vector<PointLabel> labels_before(work.size());
    directions_.beginBatch();
    for (std::size_t n = 0; n < work.size(); ++n) {
      items[n].id = work[n];
      items[n].candidates = directions_.candidates(work[n]);
      labels_before[n] = scorer_.record(work[n]).label;
    }
    releaseMap();  // scoring reads the mirror and what was uploaded
    const kernels::Stopwatch scoring;
    const std::vector<kernels::ScoreResult> results = scorer_.score(items, tables_(mirror));
    for (std::size_t n = 0; n < results.size(); ++n) {
      stats.direction_tests += results[n].tests;
      stats.scored_points += results[n].tests > 0 ? 1 : 0;
      stats.label_changes += results[n].label != labels_before[n] ? 1 : 0;
    }
    noteWaiting(backlog_, scorer_, stats);
    stats.score_ms = scoring.milliseconds();
    return stats;
  }

  std::uint64_t bytes() const override {
    return backlog_.bytes() + fresh_.capacity() * sizeof(std::uint32_t) + triggers_.bytes() + touched_.bytes();
  }

 private:
  void enqueueAll() {
    backlog_.grow(scorer_.points().size());
    for (; known_points_ < scorer_.points().size(); ++known_points_) fresh_.push_back(known_points_);
    for (const std::uint32_t id : scorer_.takeConfident(fresh_)) enqueue(id);
    const PaperRequests asked = triggers_.take();
    for (const std::uint32_t id : asked.jumped) enqueue(id);
    for (const std::uint32_t id : asked.sampled) enqueue(id);
    if (!asked.blocked) return;
    for (std::uint32_t id = 0; id < known_points_; ++id) {
      if (scorer_.record(id).label != PointLabel::Accessible) enqueue(id);
    }
  }

  void enqueue(std::uint32_t id) {
    if (!backlog_.holds(id) && scorer_.confidentEnough(id)) backlog_.ask(id, 1);
  }

  PointScorer& scorer_;
  MakeTables tables_;
  PaperTriggers triggers_;
  CandidateDirections directions_;
  Backlog backlog_;
  std::vector<std::uint32_t> fresh_;  ///< below the confidence bound, ascending
  std::uint32_t known_points_ = 0;
  IdList touched_;  ///< since the last update
};

}  // namespace

std::unique_ptr<UpdateScheduler> makePaperOnHost(const ScheduledTool& tool) {
  return std::make_unique<PaperOnHost>(tool);
}

}  // namespace accessvdb::internal
