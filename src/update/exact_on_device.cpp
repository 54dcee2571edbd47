// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a backend that decides itself what is due (launch/exact_updater.h): the host only reports which
/// points are new, touched or now confident (device_admission.h), and in which leaves facts flipped. Without a budget
/// the results equal those of exact_on_host.cpp. All this is the same for tools that are tried in the same directions,
/// so that one scheduler serves them.
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <utility>
#include <vector>

#include "hostdev/cell_counts.h"
#include "hostdev/direction_filter.h"
#include "launch/lists.h"
#include "update/block_groups.h"
#include "update/cell_directions.h"
#include "update/corridor_offsets.h"
#include "update/device_admission.h"
#include "update/direction_arcs.h"
#include "update/flip_set.h"
#include "update/leaf_footprint.h"
#include "update/make_scheduler.h"
#include "update/run_beside.h"

namespace accessvdb::internal {
namespace {

/// Flipped leaves are merged once this many wait, so that a long period without updates takes bounded memory.
constexpr std::size_t kMostFlips = std::size_t{1} << 22;
/// In voxels: 8.4 MB.
constexpr std::int32_t kMostCorridorReach = 256;

/// Adds two counts of freed voxels, cell by cell.
std::uint64_t joinedFreed(std::uint64_t a, std::uint64_t b) {
  std::uint64_t sum = 0;
  for (int shift = 0; shift < 64; shift += 8) {
    const std::uint64_t cell = (a >> shift & 0xff) + (b >> shift & 0xff);
    sum |= std::min<std::uint64_t>(cell, kernels::LeafFlips::kManyFreed) << shift;
  }
  return sum;
}

/// Appends codes of the voxels of a leaf. @param collides  what they began to do, or ceased
void appendVoxels(const LeafBits& bits, bool collides, std::vector<std::uint16_t>& voxels) {
  for (std::size_t x = 0; x < bits.size(); ++x) {
    for (std::uint64_t left = bits[x]; left != 0; left &= left - 1) {
      voxels.push_back(kernels::flipped_voxel::codeOf(static_cast<int>(64 * x) + std::countr_zero(left), collides));
    }
  }
}

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

  // The backend finds neighbours while the map integrates the scan.
  void noteReturns(const TouchedPoints& touched, std::span<const Eigen::Vector3f> p_L,
                   std::span<const Eigen::Vector3f> q_L) override {
    flips_begun_ = false;
    if (admission_.handOver(touched)) updater_->findNeighbours();
    admission_.noteReturns(touched, p_L, q_L);
  }

  Needs needs() const override { return {.deltas = admission_.takesDeltas(), .changes = true}; }
  void noteChange(std::size_t list, const LeafChange& change) override {
    if (!notes_flips_) return;
    const Index3 leaf = parentOf(change.origin_ijk);
    const kernels::ColumnsForArm freed = kernels::columnsForArm(change.arm_free_on.data()),
                                 blocked = kernels::columnsForArm(change.arm_free_off.data());
    kernels::LeafFlips flips = {{leaf[0], leaf[1], leaf[2]},
                                kindsOf(change),
                                static_cast<std::uint8_t>(freed.heights),
                                static_cast<std::uint8_t>(blocked.heights),
                                kernels::countCells(change.collides_off.data()),
                                freed.columns,
                                blocked.columns};
    if (takes_voxels_) {
      std::vector<std::uint16_t>& voxels = voxels_[list];
      const std::size_t before = voxels.size();
      appendVoxels(change.collides_on, true, voxels);
      appendVoxels(change.collides_off, false, voxels);
      flips.first_voxel = voxels_before_[list] + static_cast<std::uint32_t>(before);
      flips.voxels = static_cast<std::uint32_t>(voxels.size() - before);
    }
    flips_[list].push_back(flips);
  }

  void noteChanges(std::span<const Eigen::Vector3f>, std::span<const Eigen::Vector3f>, const MapChanges&) override {
    if (!anything_scored_) {  // nothing to invalidate: no update has evaluated a point yet
      notes_flips_ = false;
      clearFlips();
    }
    if (kernels::totalSize(flips_) > 2 * joined_flips_ + kMostFlips) joinFlips();
  }

  // As if another scan had come: all flips are handed over again.
  void noteChangesAlone(std::span<const std::span<const LeafChange>> facts) override {
    flips_begun_ = false;
    noteEachList(facts);
    noteChanges({}, {}, {});
  }

  void noteRestored() override { admission_.noteRestored(); }

  // If another scan comes before the update, all flips are handed over again.
  void prepare(const kernels::OccupancyGrid* mirror) override {
    if (!admission_.isAhead()) return;
    begin(mirror);
    flips_begun_ = true;
  }

  UpdateStats update(const kernels::OccupancyGrid* mirror) override {
    const bool begun = std::exchange(flips_begun_, false);
    // First what reads the points: growing may lose the state of those that came with the first of several scans.
    if (!begun) begin(mirror);
    admission_.growState();
    admission_.complete();
    const kernels::ScoringInput input = inputs_.of(mirror);
    const auto read_host = [&] {
      admission_.readWeights();
      admission_.know();
      clearFlips();
      notes_flips_ = true;
      releaseMap();  // from here on the next scan may come, and note its flips
    };
    runBeside([&] { updater_->choose(input); }, read_host);
    const kernels::UpdateOutcome outcome = updater_->update(input, admission_.confidence());
    anything_scored_ = anything_scored_ || outcome.evaluated > 0;
    return statsOf(outcome);
  }

  std::uint64_t bytes() const override {
    const auto bytesOf = [](const auto& list) { return list.capacity() * sizeof(list[0]); };
    std::uint64_t bytes = admission_.bytes();
    for (const std::vector<kernels::LeafFlips>& part : flips_) bytes += bytesOf(part);
    for (const std::vector<std::uint16_t>& part : voxels_) bytes += bytesOf(part);
    return bytes;
  }
  std::uint64_t deviceBytes() const override { return updater_->bytes(); }

 private:
  void begin(const kernels::OccupancyGrid* mirror) {
    std::array<std::span<const kernels::LeafFlips>, kMostLists> lists;
    std::array<std::span<const std::uint16_t>, kMostLists> voxels;
    // The device gets all lists behind each other, so that a leaf's voxels begin further back.
    std::array<std::uint32_t, kMostLists> more = {};
    std::uint32_t before = 0;
    for (std::size_t n = 0; n < kMostLists; ++n) {
      more[n] = before - std::exchange(voxels_before_[n], before);
      before += static_cast<std::uint32_t>(voxels_[n].size());
    }
    tbb::parallel_for(std::size_t{0}, kMostLists, [&](std::size_t n) {
      if (more[n] == 0) return;
      for (kernels::LeafFlips& flips : flips_[n]) flips.first_voxel += more[n];
    });
    std::ranges::copy(flips_, lists.begin());
    std::ranges::copy(voxels_, voxels.begin());
    updater_->begin(inputs_.of(mirror), {lists, voxels});
  }

  void clearFlips() {
    for (std::vector<kernels::LeafFlips>& part : flips_) part.clear();
    for (std::vector<std::uint16_t>& part : voxels_) part.clear();
    voxels_before_ = {};
    joined_flips_ = 0;
  }
  void joinFlips() {
    tbb::parallel_for(std::size_t{0}, kMostLists, [&](std::size_t n) {
      for (kernels::LeafFlips& flips : flips_[n]) flips.first_voxel -= voxels_before_[n];
      join(flips_[n], voxels_[n]);
    });
    voxels_before_ = {};
    joined_flips_ = kernels::totalSize(flips_);
  }
  static void join(std::vector<kernels::LeafFlips>& flips, std::vector<std::uint16_t>& voxels) {
    const auto place = [](const kernels::LeafFlips& f) { return std::array{f.leaf[0], f.leaf[1], f.leaf[2]}; };
    tbb::parallel_sort(flips.begin(), flips.end(),
                       [&](const kernels::LeafFlips& a, const kernels::LeafFlips& b) { return place(a) < place(b); });
    std::size_t out = 0;
    std::vector<std::uint16_t> joined;
    std::array<std::int8_t, 512> began = {};  // of the leaf: 1: collides now but did not, -1: the other way
    for (std::size_t n = 0; n < flips.size(); ++n) {
      const kernels::LeafFlips flip = flips[n];
      for (std::uint32_t v = 0; v < flip.voxels; ++v) {
        const std::uint16_t code = voxels[flip.first_voxel + v];
        began[code >> 1] = static_cast<std::int8_t>(began[code >> 1] + ((code & 1) != 0 ? 1 : -1));
      }
      if (out > 0 && place(flips[out - 1]) == place(flip)) {
        flips[out - 1].kinds |= flip.kinds;
        flips[out - 1].freed_heights |= flip.freed_heights;
        flips[out - 1].blocked_heights |= flip.blocked_heights;
        flips[out - 1].blocked_columns |= flip.blocked_columns;
        flips[out - 1].freed = joinedFreed(flips[out - 1].freed, flip.freed);
        flips[out - 1].freed_columns |= flip.freed_columns;
      } else {
        flips[out++] = flip;
      }
      if (n + 1 < flips.size() && place(flips[n + 1]) == place(flip)) continue;
      flips[out - 1].first_voxel = static_cast<std::uint32_t>(joined.size());
      for (std::size_t at = 0; at < began.size(); ++at) {
        if (began[at] != 0) joined.push_back(kernels::flipped_voxel::codeOf(static_cast<int>(at), began[at] > 0));
        began[at] = 0;
      }
      flips[out - 1].voxels = static_cast<std::uint32_t>(joined.size()) - flips[out - 1].first_voxel;
    }
    flips.resize(out);
    voxels = std::move(joined);
  }

  ScoringInputs inputs_;
  std::unique_ptr<kernels::ExactUpdater> updater_;
  bool takes_voxels_;
  DeviceAdmission admission_;
  bool anything_scored_ = false;
  bool notes_flips_ = false;  ///< an update has scored something, or may be doing so
  bool flips_begun_ = false;  ///< prepare() was called since the last scan
  std::array<std::vector<kernels::LeafFlips>, kMostLists> flips_;  ///< since the last update, by list
  std::array<std::vector<std::uint16_t>, kMostLists> voxels_;      ///< FlipLists::voxels
  std::array<std::uint32_t, kMostLists> voxels_before_ = {};       ///< added to LeafFlips::first_voxel of a list so far
  std::size_t joined_flips_ = 0;                                   ///< their number after the last merge
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
