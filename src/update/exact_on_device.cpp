// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a backend that decides itself what is due (launch/exact_updater.h): the host only reports which
/// points are new, touched or now confident (device_admission.h), and in which leaves facts flipped. Without a budget
/// the results equal those of exact_on_host.cpp. All this is the same for tools that are tried in the same directions,
/// so that one scheduler serves them.
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "hostdev/direction_filter.h"
#include "launch/lists.h"
#include "update/block_groups.h"
#include "update/cell_directions.h"
#include "update/corridor_offsets.h"
#include "update/device_admission.h"
#include "update/direction_arcs.h"
#include "update/leaf_footprint.h"
#include "update/make_scheduler.h"
#include "update/run_beside.h"
#include "update/waiting_flips.h"

namespace accessvdb::internal {
namespace {

/// Flipped leaves are merged once this many wait, so that a long period without updates takes bounded memory.
constexpr std::size_t kMostFlips = std::size_t{1} << 22;
/// In voxels: 8.4 MB.
constexpr std::int32_t kMostCorridorReach = 256;

std::vector<PointScorer*> scorersOf(std::span<const ScheduledTool> tools) {
  std::vector<PointScorer*> scorers;
  for (const ScheduledTool& tool : tools) scorers.push_back(&tool.scorer);
  return scorers;
}

class ExactOnDevice final : public UpdateScheduler {
 public:
  /// @param group_log2  same as the updater's
  ExactOnDevice(std::span<const ScheduledTool> tools, std::unique_ptr<kernels::ExactUpdater> updater, int group_log2)
      : inputs_({tools.begin(), tools.end()}),
        updater_(std::move(updater)),
        takes_voxels_(updater_->takesVoxels()),
        admission_(scorersOf(tools), *updater_, group_log2) {}

  void noteBlocks(std::span<const std::uint32_t> changed) override { admission_.describeBlocks(changed); }

  // The backend finds neighbours while the map integrates the scan.
  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    flips_begun_ = std::exchange(flips_begun_ahead_, false);
    const auto hand_over = [&] {
      if (admission_.handOver(touched)) updater_->findNeighbours();
    };
    const bool is_in_map = flips_begun_;  // a device that leads has fused it
    runBeside(hand_over, [&] { admission_.noteReturns(touched, p_L, q_L, is_in_map); });
  }

  Needs needs() const override { return {.deltas = admission_.takesDeltas(), .changes = true}; }
  void noteChange(std::size_t list, const LeafChange& change) override {
    if (!notes_flips_) return;
    flips_[list].add(change, takes_voxels_);
  }

  void noteChanges(std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>, const MapChanges&) override {
    if (!anything_scored_) {  // nothing to invalidate: no update has evaluated a point yet
      notes_flips_ = false;
      clearFlips();
    }
    // Flips of a device and of the host are not handed over together.
    if (fuser_ != nullptr && (waitingOnDevice() > kMostFlips || (waiting() > 0 && waitingOnDevice() > 0))) {
      flips_begun_ = false;
      flips_[0].beginVoxelsAt(0);
      flips_[0].takeFrom(*fuser_);
    }
    if (waiting() > 2 * joined_ + kMostFlips) joinFlips();
  }

  // As if another scan had come: all flips are handed over again.
  void noteChangesAlone(std::span<const std::span<const LeafChange>> facts) override {
    flips_begun_ = flips_begun_ahead_ = false;
    admission_.forgetWeights();
    noteEachList(facts);
    noteChanges({}, {}, {});
  }

  void noteRestored() override { admission_.noteRestored(); }

  // If another scan comes before the update, all flips are handed over again.
  void prepare(const kernels::OccupancyGrid* mirror) override {
    if (!admission_.isAhead() || flips_begun_) return;
    begin(mirror);
    flips_begun_ = true;
  }

  // What flips mean is found from points that had a state before: those of the scan are not needed.
  void prepareFlips(const kernels::OccupancyGrid* mirror) override {
    if (!notes_flips_ || !anything_scored_) return;  // then noteChanges() clears them
    if (!admission_.isNextFirst() || waiting() > 0 || waitingOnDevice() > kMostFlips) return;
    begin(mirror);
    flips_begun_ahead_ = true;
  }

  UpdateStats update(const kernels::OccupancyGrid* mirror, int budget_points) override {
    const bool begun = std::exchange(flips_begun_, false);
    // First what reads the points: growing may lose the state of those that came with the first of several scans.
    if (!begun) begin(mirror);
    admission_.growState();
    admission_.complete();
    const kernels::ScoringInput input = inputs_.of(mirror, budget_points);
    runBeside([&] { updater_->choose(input); }, [&] { admission_.readWeights(); });
    const auto release_host = [&] {
      admission_.know();
      clearFlips();
      notes_flips_ = true;
      releaseMap();  // from here on the next scan may come, and note its flips
    };
    kernels::UpdateOutcome outcome;
    const auto search = [&] { outcome = updater_->update(input, admission_.confidence()); };
    if (tbb::this_task_arena::max_concurrency() > 1) {
      runBeside(search, release_host);
    } else {  // the next scan need not wait for the device
      release_host();
      search();
    }
    admission_.noteWaiting(outcome);
    anything_scored_ = anything_scored_ || outcome.evaluated > 0;
    return statsOf(outcome);
  }

  bool takesFlipsOnDevice() const override { return true; }
  void takeFlipsOf(kernels::ScanFuser* fuser) override {
    if (fuser == nullptr && fuser_ != nullptr) {
      flips_begun_ = flips_begun_ahead_ = false;
      admission_.forgetWeights();
      flips_[0].beginVoxelsAt(0);
      flips_[0].takeFrom(*fuser_);
      if (!notes_flips_) clearFlips();
    }
    fuser_ = fuser;
  }

  std::uint64_t bytes() const override {
    std::uint64_t bytes = admission_.bytes();
    for (const WaitingFlips& part : flips_) bytes += part.bytes();
    return bytes;
  }
  std::uint64_t deviceBytes() const override { return updater_->bytes(); }

 private:
  void begin(const kernels::OccupancyGrid* mirror) {
    std::array<std::span<const kernels::LeafFlips>, kMostLists> lists;
    std::array<std::span<const std::uint16_t>, kMostLists> voxels;
    // The device gets all lists behind each other, so that a leaf's voxels begin further back.
    std::array<std::uint32_t, kMostLists> first = {};
    for (std::size_t n = 0; n < kMostLists; ++n) {
      lists[n] = flips_[n].leaves();
      voxels[n] = flips_[n].voxels();
      if (n > 0) first[n] = first[n - 1] + static_cast<std::uint32_t>(voxels[n - 1].size());
    }
    tbb::parallel_for(std::size_t{0}, kMostLists, [&](std::size_t n) { flips_[n].beginVoxelsAt(first[n]); });
    const kernels::FlipsOnDevice on_device = fuser_ != nullptr ? fuser_->flips() : kernels::FlipsOnDevice();
    updater_->begin(inputs_.of(mirror, 0), {lists, voxels, on_device});  // it scores nothing
  }

  void clearFlips() {
    for (WaitingFlips& part : flips_) part.clear();
    if (fuser_ != nullptr) fuser_->clearFlips();
    joined_ = 0;
  }
  /// Leaves and, since they take as much memory, eight voxels each.
  [[nodiscard]] std::size_t waiting() const {
    std::size_t waiting = 0;
    for (const WaitingFlips& part : flips_) waiting += part.leaves().size() + part.voxels().size() / 8;
    return waiting;
  }
  [[nodiscard]] std::size_t waitingOnDevice() const {
    const kernels::FlipsOnDevice flips = fuser_->flips();
    return flips.count + flips.voxel_count / 8;
  }
  void joinFlips() {
    tbb::parallel_for(std::size_t{0}, kMostLists, [&](std::size_t n) { flips_[n].join(); });
    joined_ = waiting();
  }

  ScoringInputs inputs_;
  std::unique_ptr<kernels::ExactUpdater> updater_;
  bool takes_voxels_;
  DeviceAdmission admission_;
  kernels::ScanFuser* fuser_ = nullptr;  ///< has the flips of scans, if a device leads
  bool anything_scored_ = false;
  bool notes_flips_ = false;                    ///< an update has scored something, or may be doing so
  bool flips_begun_ = false;                    ///< the backend has begun with all flips
  bool flips_begun_ahead_ = false;              ///< and with those of a scan that is not noted yet
  std::array<WaitingFlips, kMostLists> flips_;  ///< since the last update, by list
  std::size_t joined_ = 0;                      ///< how many were waiting after the last merge
};

/// A tool's tables in host memory, for as long as the updater is being made.
class TablesOfTool {
 public:
  TablesOfTool(const HostTables& host, double voxel_size_m, int group_log2)
      : any_directions_(host.approach.axes_xyz != nullptr),
        arc_(any_directions_ ? 0 : kernels::mostInCone(host.approach.num_directions, host.approach.normal_cos_min)),
        footprint_(host.tool, host.approach, voxel_size_m, group_log2),
        cells_(host.tool, host.approach.num_directions, group_log2, any_directions_),
        corridors_(host.approach, voxel_size_m, kMostCorridorReach) {
    if (!any_directions_) arcs_.emplace(host.tool, host.approach.num_directions);
  }

  [[nodiscard]] kernels::ToolTables tables() const {
    kernels::ToolTables tables;
    tables.tool_columns = footprint_.toolColumns();
    tables.arm_columns = footprint_.armColumns();
    tables.any_directions = any_directions_;
    tables.arc = arc_;
    tables.cell_directions = cells_.table();
    tables.cell_sets = cells_.sets();
    std::ranges::copy(cells_.low(), tables.cell_low);
    std::ranges::copy(cells_.size(), tables.cell_size);
    tables.corridors = corridors_.table();
    tables.corridor_reach = corridors_.reach();
    if (arcs_) tables.arcs = arcs_->table();
    return tables;
  }

 private:
  bool any_directions_;
  int arc_;
  LeafFootprint footprint_;
  CellDirections cells_;
  CorridorOffsets corridors_;
  std::optional<DirectionArcs> arcs_;
};

}  // namespace

std::unique_ptr<UpdateScheduler> makeExactOnDevice(std::span<const ScheduledTool> tools) {
  PointScorer& scorer = tools.front().scorer;
  const int num_directions = tools.front().host.approach.num_directions;
  // Of a wide set the host decides what is due, and the device searches.
  if (kernels::isWide(num_directions)) return nullptr;
  const FieldParams& params = scorer.params();
  const int group_log2 = blockGroupLog2(params.tsdf.voxel_size_m);
  std::vector<TablesOfTool> made;
  for (const ScheduledTool& tool : tools) made.emplace_back(tool.host, params.tsdf.voxel_size_m, group_log2);
  std::vector<kernels::ToolTables> tables;
  for (const TablesOfTool& tool : made) tables.push_back(tool.tables());
  auto updater = scorer.backend().makeExactUpdater({tables, neighbourTables(params, num_directions, group_log2)});
  if (updater == nullptr) return nullptr;
  for (const ScheduledTool& tool : tools.subspan(1)) tool.scorer.shareDevice(scorer);
  return std::make_unique<ExactOnDevice>(tools, std::move(updater), group_log2);
}

}  // namespace accessvdb::internal
