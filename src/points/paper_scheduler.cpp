// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's incremental updates: new points, three triggers, a budget, a backlog (paper, "Incremental Updates and
/// Confidence"; SPEC a.8). Labels are not those of a full evaluation; they approach them.
///
/// Left out on purpose: the paper adapts its budget to the time that the last frame took, which makes results depend on
/// the machine and its load. Here the budget is UpdateParams::budget_points, so that runs are repeatable. There is no
/// sliding window either: the map keeps everything.
#include <algorithm>
#include <deque>
#include <vector>

#include "points/coarse_to_fine.h"
#include "points/paper_triggers.h"
#include "points/stopwatch.h"
#include "points/update_scheduler.h"

namespace accessvdb::internal {
namespace {

class PaperScheduler final : public UpdateScheduler {
 public:
  PaperScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool, const kernels::ApproachView& approach)
      : scorer_(scorer), triggers_(scorer), directions_(scorer, approach.num_directions, tool.collision_limit) {}

  void noteReturns(const TouchedPoints&, std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>) override {}

  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   std::span<const std::span<const LeafChange>>) override {
    queued_.grow(scorer_.points().size(), 0);
    for (const std::uint32_t id : fresh_) enqueue(id);
    fresh_.clear();
    for (; known_points_ < scorer_.points().size(); ++known_points_) enqueue(known_points_);
    triggers_.fire(p_L, q_L, [this](std::uint32_t id) { enqueue(id); });
  }

  UpdateStats update(const ScoringTables& tables) override {
    UpdateStats stats;
    scorer_.grow();
    const std::vector<std::uint32_t> work = takeWork(stats);
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
    stats.backlog = queue_.size();
    const Stopwatch scoring;
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
    return (queue_.size() + fresh_.capacity()) * sizeof(std::uint32_t) + queued_.bytes() + triggers_.bytes();
  }

 private:
  void enqueue(std::uint32_t id) {
    if (queued_[id] != 0) return;
    queued_[id] = 1;
    queue_.push_back(id);
  }

  /// Takes as many points as the budget allows to evaluate, first come first served. Points below the confidence bound
  /// are skipped, keep their state, cost no budget, and wait for the next scan: nothing changes for them before.
  std::vector<std::uint32_t> takeWork(UpdateStats& stats) {
    const int budget = scorer_.params().update.budget_points;
    const std::size_t most = budget > 0 ? static_cast<std::size_t>(budget) : queue_.size();
    std::vector<std::uint32_t> work;
    while (work.size() < most && !queue_.empty()) {
      const std::size_t count = std::min(most - work.size(), queue_.size());
      const std::vector<std::uint32_t> taken(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(count));
      queue_.erase(queue_.begin(), queue_.begin() + static_cast<std::ptrdiff_t>(count));
      scorer_.refreshWeights(taken);
      for (const std::uint32_t id : taken) {
        queued_[id] = 0;
        (scorer_.confidentEnough(id) ? work : fresh_).push_back(id);
      }
      stats.dirty_points += count;
    }
    return work;
  }

  PointScorer& scorer_;
  PaperTriggers triggers_;
  CoarseToFine directions_;
  std::deque<std::uint32_t> queue_;
  ChunkedArray<std::uint8_t> queued_;  ///< by id: in queue_
  std::vector<std::uint32_t> fresh_;   ///< below the confidence bound, not in queue_
  std::uint32_t known_points_ = 0;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makePaperScheduler(PointScorer& scorer, const kernels::ToolKernelView& tool,
                                                    const kernels::ApproachView& approach) {
  return std::make_unique<PaperScheduler>(scorer, tool, approach);
}

}  // namespace accessvdb::internal
