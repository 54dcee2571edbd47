// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The paper's policy on a backend that keeps queue and state itself (launch/paper_updater.h). The host finds what
/// needs the map or random numbers: which points became confident, and what triggers (i) and (ii) request. The
/// results equal those of paper_on_host.cpp.
#include <memory>
#include <utility>

#include "update/block_groups.h"
#include "update/coarse_to_fine.h"
#include "update/device_admission.h"
#include "update/make_scheduler.h"
#include "update/paper_triggers.h"
#include "update/run_beside.h"

namespace accessvdb::internal {
namespace {

class PaperOnDevice final : public UpdateScheduler {
 public:
  /// @param group_log2  same as the updater's
  PaperOnDevice(const ScheduledTool& tool, std::unique_ptr<kernels::PaperUpdater> updater, int group_log2)
      : inputs_({tool}),
        updater_(std::move(updater)),
        admission_({&tool.scorer}, *updater_, group_log2),
        triggers_(tool.scorer) {}

  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    admission_.handOver(touched);
    admission_.noteReturns(touched, p_L, q_L, false);
  }

  Needs needs() const override { return {.deltas = admission_.takesDeltas(), .distances = true}; }
  void noteChanges(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                   const MapChanges& changes) override {
    triggers_.note(p_L, q_L, changes.distances);
  }

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    admission_.growState();
    admission_.complete();
    admission_.readWeights();
    const PaperRequests asked = triggers_.take();
    const kernels::TriggeredPoints triggered = {asked.jumped, asked.sampled, asked.blocked};
    const kernels::ScoringInput input = inputs_.of(mirror, budget_points);
    kernels::UpdateOutcome outcome;
    const auto leave_host = [&] {
      admission_.know();
      releaseMap();
    };
    runBeside([&] { outcome = updater_->update(input, admission_.confidence(), triggered); }, leave_host);
    admission_.noteWaiting(outcome);
    UpdateStats stats = statsOf(outcome);
    stats.moved_points = stats.dirty_points;  // each point's neighbourhood is made when its turn comes
    return stats;
  }

  std::uint64_t bytes() const override { return admission_.bytes() + triggers_.bytes(); }
  std::uint64_t deviceBytes() const override { return updater_->bytes(); }

 private:
  ScoringInputs inputs_;
  std::unique_ptr<kernels::PaperUpdater> updater_;
  DeviceAdmission admission_;
  PaperTriggers triggers_;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makePaperOnDevice(const ScheduledTool& tool) {
  const PointScorer& scorer = tool.scorer;
  const int group_log2 = blockGroupLog2(scorer.params().tsdf.voxel_size_m);
  kernels::PaperTables tables;
  tables.neighbours = neighbourTables(scorer.params(), scorer.points().numDirections(), group_log2);
  tables.candidates = coarseToFineRule(scorer.params());
  auto updater = scorer.backend().makePaperUpdater(tables);
  if (updater == nullptr) return nullptr;
  return std::make_unique<PaperOnDevice>(tool, std::move(updater), group_log2);
}

}  // namespace accessvdb::internal
