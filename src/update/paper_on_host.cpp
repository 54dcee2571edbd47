// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's incremental updates: new points, three triggers, a budget, a backlog (paper, "Incremental Updates and
/// Confidence"; docs/PAPER_MAP.md, "Update policy"). Labels are not those of a full evaluation; they approach them.
///
/// A point enters the queue once its confidence allows a score, and again when a trigger asks for it. The points that
/// one update puts into the queue stand in the order of their reasons, ascending in each: newly confident, (i), (ii),
/// (iii).
///
/// Left out on purpose: the paper adapts its budget to the time that the last frame took, which makes results depend on
/// the machine and its load. Here the budget is UpdateParams::budget_points, so that runs are repeatable. There is no
/// sliding window either: the map keeps everything.
#include <algorithm>
#include <deque>
#include <vector>

#include "launch/stopwatch.h"
#include "update/coarse_to_fine.h"
#include "update/id_list.h"
#include "update/paper_triggers.h"
#include "update/scheduler.h"

namespace accessvdb::internal {
namespace {

class PaperScheduler final : public UpdateScheduler {
 public:
  PaperScheduler(PointScorer& scorer, std::uint16_t collision_limit)
      : scorer_(scorer), triggers_(scorer), directions_(scorer, collision_limit) {}

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f>,
                   std::span<const Eigen::Vector3f>) override {
    touched_.add(touched.all);
  }

  bool seesDistances() const override { return true; }
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override {
    triggers_.note(p_L, q_L, changes.distances);
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    scorer_.grow();
    enqueueAll();
    refreshTouched();
    const std::vector<std::uint32_t> work = takeWork();
    stats.dirty_points = work.size();
    stats.backlog = queue_.size();
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
    const kernels::Stopwatch scoring;
    const std::vector<kernels::ScoreResult> results = scorer_.score(items, tables);
    for (std::size_t n = 0; n < results.size(); ++n) {
      stats.direction_tests += results[n].tests;
      stats.scored_points += results[n].tests > 0 ? 1 : 0;
      stats.label_changes += results[n].label != labels_before[n] ? 1 : 0;
    }
    stats.score_ms = scoring.milliseconds();
    return stats;
  }

  std::uint64_t bytes() const override {
    return (queue_.size() + fresh_.capacity()) * sizeof(std::uint32_t) + queued_.bytes() + triggers_.bytes() +
           touched_.bytes();
  }

 private:
  void enqueueAll() {
    queued_.grow(scorer_.points().size(), 0);
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

  /// What views of the points show of their weights.
  void refreshTouched() {
    std::vector<std::uint32_t> touched = touched_.take();
    std::erase_if(touched, [&](std::uint32_t id) { return !scorer_.record(id).has_neighbourhood; });
    scorer_.refreshWeights(touched);
    scorer_.upload(touched);
  }

  void enqueue(std::uint32_t id) {
    if (queued_[id] != 0 || !scorer_.confidentEnough(id)) return;
    queued_[id] = 1;
    queue_.push_back(id);
  }

  /// As many points as the budget allows to evaluate, first come first served.
  std::vector<std::uint32_t> takeWork() {
    const auto budget = static_cast<std::size_t>(scorer_.params().update.budget_points);
    const auto count = static_cast<std::ptrdiff_t>(budget > 0 ? std::min(queue_.size(), budget) : queue_.size());
    std::vector<std::uint32_t> work(queue_.begin(), queue_.begin() + count);
    queue_.erase(queue_.begin(), queue_.begin() + count);
    for (const std::uint32_t id : work) queued_[id] = 0;
    return work;
  }

  PointScorer& scorer_;
  PaperTriggers triggers_;
  CandidateDirections directions_;
  std::deque<std::uint32_t> queue_;
  ChunkedArray<std::uint8_t> queued_;  ///< by id: in queue_
  std::vector<std::uint32_t> fresh_;   ///< below the confidence bound, ascending
  std::uint32_t known_points_ = 0;
  IdList touched_;  ///< since the last update
};

}  // namespace

std::unique_ptr<UpdateScheduler> makePaperScheduler(PointScorer& scorer, std::uint16_t collision_limit) {
  return std::make_unique<PaperScheduler>(scorer, collision_limit);
}

}  // namespace accessvdb::internal
