// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a device: the order of its steps. The tables in this folder own the arrays, the rules are in
/// hostdev/. Points, neighbourhoods, flips by place and the map's busy parts are the same for all tools of the updater;
/// what each tool makes of them is its own (tool_update.h).
#include <algorithm>
#include <utility>
#include <vector>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/owned_event.h"
#include "cuda/update/busy_table.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/flip_tables.h"
#include "cuda/update/moved_tables.h"
#include "cuda/update/point_tables.h"
#include "cuda/update/tool_update.h"
#include "cuda/update/update_kernels.h"
#include "cuda/update/updaters.h"
#include "launch/counted_memory.h"
#include "launch/lists.h"

namespace accessvdb::kernels {
namespace {

static_assert(PointTables::kChunk <= ToolUpdate::kMovedChunk);
/// Most neighbourhoods found before the host knows how many are needed.
constexpr std::uint32_t kMaxPrepared = 1u << 22;

class DeviceExactUpdater final : public ExactUpdater {
 public:
  DeviceExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const ExactTables& tables)
      : context_(std::move(context)),
        memory_(memory),
        counters_(countersOf(tables.tools.size())),
        points_(context_, memory_, tables.neighbours, true),
        moved_(memory_, &shared().data()->moved),
        flips_(memory_),
        busy_(memory_) {
    for (std::size_t k = 0; k < tables.tools.size(); ++k) {
      tools_.push_back(
          std::make_unique<ToolUpdate>(context_, memory_, tables.neighbours, tables.tools[k], *counters_[k]));
    }
  }

  void begin(const ScoringInput& input, const FlipLists& flips) override {
    const CurrentDevice current(context_->device());
    const PointsView& points = points_.view();
    FlipsView by_place;
    const bool any = points.groups.groups > 0 && (totalSize(flips.leaves) > 0 || flips.on_device.count > 0);
    if (flips.on_device.count > 0) ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), context_->mirrorReady()));
    if (any) by_place = flips_.take(flips, shared(), stream());
    forEachTool(input, [&](ToolUpdate& tool, const ToolInput& own) {
      tool.takeFlips(own, points, any ? &by_place : nullptr, input.map.inverse_voxel_size);
    });
    ACCESSVDB_CUDA(cudaEventRecord(may_follow_.get(), stream()));
  }

  [[nodiscard]] bool takesVoxels() const override {
    return std::ranges::any_of(tools_, [](const auto& tool) { return tool->known().follows; });
  }

  void admit(const AdmitInput& input) override {
    const CurrentDevice current(context_->device());
    if (neighbours_begun_) {
      points_.forgetKept(moved_.view(), stream());
      reset();
    }
    const std::uint32_t first_place =
        any_known_ ? moved_.addPlaces(static_cast<std::uint32_t>(input.deltas.size())) : kNoIndex;
    points_.grow(input, stream());
    moved_.grow(input.num_points, input.num_blocks, stream());
    for (const auto& tool : tools_) tool->grow(input);
    const DeviceList<PointDelta> deltas =
        points_.admit(input, moved_.view(), tools_.front()->known(), first_place, stream());
    for (std::size_t k = 1; k < tools_.size(); ++k) {
      launchAdmitStates(input.states[k], tools_[k]->known(), deltas, stream());
    }
    ACCESSVDB_CUDA(cudaEventRecord(may_follow_.get(), stream()));
  }

  void findNeighbours() override {
    const CurrentDevice current(context_->device());
    neighbours_begun_ = true;
    moved_.find(points_.view(), points_.competition(), stream());
    const std::uint32_t most = growPrepared();
    points_.makeByCell(moved_.view(), 0, most, prepared_.data(), stream());
    launchNotePrepared(&shared().data()->moved, most, stream());
    ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
  }

  void choose(const ScoringInput& input) override {
    const CurrentDevice current(context_->device());
    points_.setState(input.tools.front().points);
    forEachTool(input, [&](ToolUpdate& tool, const ToolInput& own) {
      tool.follow(own, points_.view(), input.map.inverse_voxel_size, may_follow_.get());
    });
    if (!neighbours_begun_) {
      neighbours_begun_ = true;
      moved_.find(points_.view(), points_.competition(), stream());
      ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
    }
    const UpdateCounters found = readMirror(input);
    const ToolUpdate::Setting setting = {points_.view(), input.map, makeBusy(input, found.mirror.lowers),
                                         input.budget_points, moved_.view().changed_bits};
    forEachTool(input, [&](ToolUpdate& tool, const ToolInput& own) { tool.choose(own, setting); });
    takeMoved(0, found.moved.prepared, Neighbours::Prepared);
    takeMoved(found.moved.prepared, found.moved.moved, Neighbours::ByCell);
    taken_ = found.moved.moved;
    for (const auto& tool : tools_) tool->takeFlipped();
  }

  UpdateOutcome update(const ScoringInput& /*input*/, const ConfidenceDelta& confidence) override {
    const CurrentDevice current(context_->device());
    points_.setWeights(confidence.weights, stream());
    moved_.addCrossed(confidence.crossed, points_.view().points, stream());
    const std::uint32_t moved = shared().read(stream()).moved.moved;
    takeMoved(taken_, moved, Neighbours::ByPoint);
    for (const auto& tool : tools_) tool->takeTurn();
    for (const auto& tool : tools_) tool->evaluate();
    std::vector<UpdateCounters> done;
    for (const auto& counters : counters_) done.push_back(counters->read(stream()));
    UpdateOutcome outcome;
    outcome.moved = done.front().moved.moved;
    for (const UpdateCounters& of_tool : done) add(of_tool.outcome, outcome);
    for (const auto& tool : tools_) {
      outcome.waiting += tool->waiting();
      outcome.waiting_updates = std::max(outcome.waiting_updates, tool->waitingUpdates());
      outcome.score_ms += tool->takeScore_ms();
      WorkQueue::Left left = tool->left();
      outcome.withheld += left.accessible;
      outcome.waiting_ids.push_back(std::move(left.ids));
    }
    any_known_ = any_known_ || moved > 0;
    last_moved_ = moved;
    reset();
    requireNeighbours(done.front().moved);
    return outcome;
  }

  std::uint64_t bytes() const override {
    std::uint64_t bytes = memory_.bytes();
    bytes += points_.mappedBytes();
    for (const auto& tool : tools_) bytes += tool->mappedBytes();
    return bytes;
  }

 private:
  [[nodiscard]] cudaStream_t stream() const { return context_->stream(); }
  [[nodiscard]] std::uint32_t* failed() const { return &shared().data()->moved.failed; }

  [[nodiscard]] DeviceCounters& shared() const { return *counters_.front(); }

  [[nodiscard]] std::vector<std::unique_ptr<DeviceCounters>> countersOf(std::size_t tools) {
    std::vector<std::unique_ptr<DeviceCounters>> counters;
    for (std::size_t k = 0; k < tools; ++k) counters.push_back(std::make_unique<DeviceCounters>(memory_, stream()));
    return counters;
  }
  template <typename Visit>
  void forEachTool(const ScoringInput& input, const Visit& visit) {
    for (std::size_t k = 0; k < tools_.size(); ++k) visit(*tools_[k], input.tools[k]);
  }
  static void add(const OutcomeCounters& counted, UpdateOutcome& outcome) {
    outcome.evaluated += counted.evaluated;
    outcome.scored += counted.scored;
    outcome.tests += counted.tests;
    outcome.label_changes += counted.label_changes;
  }

  /// Counts the mirror's lower nodes. Needs the mirror and the list of moved points; after findNeighbours() it runs
  /// concurrently with the device work of begin(), which may take longer.
  /// @return the counters, with those points counted
  [[nodiscard]] UpdateCounters readMirror(const ScoringInput& input) {
    const cudaStream_t beside = context_->priorityStream();
    ACCESSVDB_CUDA(cudaStreamWaitEvent(beside, moved_found_.get()));
    launchCountLowers(input.map.grid, &shared().data()->mirror.lowers, beside);
    return shared().read(beside);
  }

  /// Lists the parts of the map with anything in them, also concurrently with the work of begin().
  [[nodiscard]] BusyMapView makeBusy(const ScoringInput& input, std::uint32_t lowers) {
    const cudaStream_t beside = context_->priorityStream();
    const BusyMapView busy = busy_.make(input.map.grid, lowers, &shared().data()->mirror.listed_lowers, beside);
    ACCESSVDB_CUDA(cudaEventRecord(busy_made_.get(), beside));
    ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), busy_made_.get()));
    return busy;
  }

  /// How the neighbourhoods of moved points are made.
  enum class Neighbours {
    Prepared,  ///< findNeighbours() has made them
    ByCell,    ///< for points near touched ones
    ByPoint    ///< for those that became confident
  };
  /// Stores the neighbourhoods of the moved points [begin, end), and lists what is due at them.
  void takeMoved(std::uint32_t begin, std::uint32_t end, Neighbours neighbours) {
    const bool prepared = neighbours == Neighbours::Prepared;
    if (!prepared && begin < end) points_.growChunks(end - begin);
    const std::uint32_t most = prepared ? ToolUpdate::kMovedChunk : PointTables::kChunk;
    for (std::uint32_t first = begin, count = 0; first < end; first += count) {
      count = std::min(end - first, most);
      const PointChunk part = moved_.part(first, count);
      FoundNeighbourhood* const found = neighbourhoodsOf(part, neighbours);
      launchStoreNeighbours(points_.view(), part, found, moved_.view().changed_bits,
                            points_.competition().choice.isMade(), stream());
      for (const auto& tool : tools_) tool->takeMoved(part, found);
    }
  }

  [[nodiscard]] FoundNeighbourhood* neighbourhoodsOf(const PointChunk& part, Neighbours neighbours) {
    switch (neighbours) {
      case Neighbours::Prepared:
        return prepared_.data() + part.first;
      case Neighbours::ByCell:
        return points_.makeByCell(moved_.view(), part, stream());
      case Neighbours::ByPoint:
        return points_.makeNeighbourhoods(part, failed(), stream());
    }
    return nullptr;
  }

  /// Makes room for neighbourhoods before the host knows how many: about as many as last time, or fewer if memory is
  /// short. update() finds the others, which only costs time. @return how many fit
  std::uint32_t growPrepared() {
    std::uint32_t most = std::min({last_moved_ + last_moved_ / 8, kMaxPrepared, most_prepared_});
    while (true) {
      try {
        points_.growLeft(most);
        prepared_.growWithRoom(memory_, most, std::min<std::size_t>(roomFor(most), kMaxPrepared), 0);
        return most;
      } catch (const ResourceLimit&) {
        if (most < PointTables::kChunk) return most_prepared_ = 0;
        most_prepared_ = most /= 2;
      }
    }
  }

  void reset() {
    for (const auto& counters : counters_) counters->clear(stream());
    moved_.clear(stream());
    points_.clearTouched(stream());
    neighbours_begun_ = false;
  }

  std::shared_ptr<DeviceContext> context_;
  CountedMemory memory_;
  OwnedEvent moved_found_{cudaEventDisableTiming}, busy_made_{cudaEventDisableTiming};
  OwnedEvent may_follow_{cudaEventDisableTiming};          ///< flips and points are there
  std::vector<std::unique_ptr<DeviceCounters>> counters_;  ///< per tool; the first also counts what all tools share
  PointTables points_;
  MovedTables moved_;
  FlipTables flips_;
  BusyTable busy_;
  DeviceArray<FoundNeighbourhood> prepared_;  ///< of the first moved points, by findNeighbours()
  std::vector<std::unique_ptr<ToolUpdate>> tools_;
  bool any_known_ = false;         ///< whether any point has a neighbourhood
  bool neighbours_begun_ = false;  ///< what was admitted since the last update has had its moved points listed
  std::uint32_t last_moved_ = 0;
  std::uint32_t most_prepared_ = kMaxPrepared;  ///< less once memory was short
  std::uint32_t taken_ = 0;  ///< in this update: number of moved points that have taken over their neighbourhoods
};

}  // namespace

std::unique_ptr<ExactUpdater> makeExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                               const ExactTables& tables) {
  const CurrentDevice current(context->device());
  return std::make_unique<DeviceExactUpdater>(std::move(context), memory, tables);
}

}  // namespace accessvdb::kernels
