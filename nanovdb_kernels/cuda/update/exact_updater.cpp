// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a device: the order of its steps. The tables in this folder own the arrays, the rules are in
/// hostdev/.
#include <algorithm>

#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/owned_event.h"
#include "cuda/update/busy_table.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/due_lists.h"
#include "cuda/update/flip_tables.h"
#include "cuda/update/footprint_table.h"
#include "cuda/update/known_tables.h"
#include "cuda/update/moved_tables.h"
#include "cuda/update/point_tables.h"
#include "cuda/update/update_kernels.h"
#include "cuda/update/updaters.h"
#include "cuda/update/work_queue.h"
#include "launch/counted_memory.h"
#include "launch/stopwatch.h"

namespace accessvdb::kernels {
namespace {

/// Most points whose neighbours are found at a time.
constexpr std::uint32_t kMovedPart = PointTables::kPart;
/// Most neighbourhoods found before the host knows how many are needed.
constexpr std::uint32_t kMaxPrepared = 1u << 20;
/// Shared memory that a block gets without asking.
constexpr int kPlainSharedBytes = 44 * 1024;

class DeviceExactUpdater final : public ExactUpdater {
 public:
  DeviceExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const ExactTables& tables)
      : context_(std::move(context)),
        memory_(memory),
        counters_(memory_, stream()),
        points_(memory_, tables.neighbours),
        moved_(memory_, &counters_.data()->moved),
        footprint_(memory_, tables),
        known_(context_, memory_, tables),
        flips_(memory_),
        due_(memory_, &counters_.data()->search),
        busy_(memory_),
        queue_(memory_) {
    ACCESSVDB_CUDA(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, context_->device()));
  }

  void begin(const ScoringInput& input, FlipLists flips) override {
    const CurrentDevice current(context_->device());
    known_.setLimit(input.tool.collision_limit);
    const PointsView& points = points_.view();
    flips_.take(
        flips,
        {points.index, points.groups, footprint_.view(), known_.cells(), known_.view(), input.approach.num_directions},
        counters_, stream());
  }

  void admit(const AdmitInput& input) override {
    const CurrentDevice current(context_->device());
    if (neighbours_begun_) reset();
    const std::uint32_t first_place =
        any_known_ ? moved_.addPlaces(static_cast<std::uint32_t>(input.news.size())) : kNoIndex;
    points_.grow(input, stream());
    moved_.grow(input.num_points, input.num_blocks, stream());
    due_.growBlocks(input.num_blocks, stream());
    known_.grow(input.num_points, input.num_groups, stream());
    points_.admit(input, moved_.view(), known_.view(), first_place, stream());
  }

  void findNeighbours() override {
    const CurrentDevice current(context_->device());
    neighbours_begun_ = true;
    moved_.find(points_.view(), stream());
    const std::uint32_t most = growPrepared();
    for (std::uint32_t first = 0; first < most; first += kMovedPart) {
      points_.makeNeighbourhoods(moved_.part(first, std::min(most - first, kMovedPart)), failed(),
                                 prepared_.data() + first, stream());
    }
    launchNotePrepared(&counters_.data()->moved, most, stream());
    ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
  }

  void choose(const ScoringInput& input) override {
    const CurrentDevice current(context_->device());
    const std::uint32_t num_points = points_.view().num_points;
    points_.setState(input.points);
    flips_.addGroups(points_.view().groups.groups, stream());
    if (input.budget_points > 0) queue_.grow(num_points, stream());
    due_.setWaiting(input.budget_points > 0 ? queue_.flags() : nullptr);
    if (!neighbours_begun_) {
      moved_.find(points_.view(), stream());
      ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
    }
    evaluation_ = {input.approach, input.rule, known_.view()};
    const MovedCounters found = prepareSearch(input);
    takeMoved(0, found.prepared, true);
    takeMoved(found.prepared, found.moved, false);
    taken_ = found.moved;
    if (flips_.masks().affected == nullptr) return;
    for (std::uint32_t first = 0, part = 0; first < num_points; first += part) {
      part = takeRoom(num_points - first, DueLists::kLeastItems);
      launchDueByFlips(dueContext(), first, part, moved_.view().changed_bits, stream());
    }
  }

  UpdateOutcome update(const ScoringInput& input, const ConfidenceNews& news) override {
    const CurrentDevice current(context_->device());
    points_.setWeights(news.weights, stream());
    moved_.addCrossed(news.crossed, points_.view().points, stream());
    const std::uint32_t moved = counters_.read(stream()).moved.moved;
    takeMoved(taken_, moved, false);
    if (input.budget_points > 0) takeTurn(input.budget_points);
    evaluate();
    const UpdateCounters done = counters_.read(stream());
    any_known_ = any_known_ || moved > 0;
    last_moved_ = moved;
    reset();
    requireNeighbours(done.moved);
    UpdateOutcome outcome;
    outcome.moved = done.moved.moved;
    outcome.evaluated = done.outcome.evaluated;
    outcome.scored = done.outcome.scored;
    outcome.tests = done.outcome.tests;
    outcome.label_changes = done.outcome.label_changes;
    outcome.waiting = queue_.size();
    outcome.score_ms = std::exchange(score_ms_, 0.0);
    return outcome;
  }

  std::uint64_t bytes() const override { return memory_.bytes() + known_.mappedBytes(); }

 private:
  [[nodiscard]] cudaStream_t stream() const { return context_->stream(); }
  [[nodiscard]] std::uint32_t* failed() const { return &counters_.data()->moved.failed; }
  [[nodiscard]] DueContext dueContext() const { return {points_.view(), evaluation_, flips_.masks(), due_.view()}; }

  /// Prepares this update's search. Needs the mirror and the list of moved points; after findNeighbours() it runs
  /// concurrently with the device work of begin(), which may take longer.
  /// @return the counters, with those points counted
  MovedCounters prepareSearch(const ScoringInput& input) {
    const cudaStream_t beside = context_->priorityStream();
    ACCESSVDB_CUDA(cudaStreamWaitEvent(beside, moved_found_.get()));
    MirrorCounters& mirror = counters_.data()->mirror;
    launchCountLowers(input.map.grid, &mirror.lowers, beside);
    const UpdateCounters found = counters_.read(beside);
    search_ = {};
    search_.map = input.map;
    search_.tool = input.tool;
    search_.multiprocessors = multiprocessors_;
    search_.slabs = input.slabs;
    search_.tool.reach = footprint_.reachOfSearch();
    // More than a block gets without asking would come out of the cache; each node takes two entries.
    search_.window = planWindow(search_.tool, kPlainSharedBytes / BusyMapView::kEntries, false);
    search_.busy = busy_.make(input.map.grid, found.mirror.lowers, &mirror.listed_lowers, beside);
    ACCESSVDB_CUDA(cudaEventRecord(busy_made_.get(), beside));
    ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), busy_made_.get()));
    due_.growItems(points_.view().num_points);
    items_ = 0;
    return found.moved;
  }

  /// Lists what is due at the moved points [begin, end). @param prepared  findNeighbours() made their neighbourhoods
  void takeMoved(std::uint32_t begin, std::uint32_t end, bool prepared) {
    if (!prepared && begin < end) points_.growParts(end - begin);
    for (std::uint32_t first = begin, count = 0; first < end; first += count) {
      count = takeRoom(std::min(end - first, kMovedPart), kMovedPart);
      const PointPart part = moved_.part(first, count);
      const Neighbourhood* found =
          prepared ? prepared_.data() + first : points_.makeNeighbourhoods(part, failed(), stream());
      launchTakeNeighbours(dueContext(), part, found, moved_.view().changed_bits, stream());
    }
  }

  /// Lists what is due at the first points in the queue.
  void takeTurn(std::uint32_t budget_points) {
    queue_.addFrom(points_.view().num_points, {kAsked, kAsked}, stream());
    const std::uint32_t turn = std::min(queue_.size(), budget_points);
    for (std::uint32_t first = 0, part = 0; first < turn; first += part) {
      part = takeRoom(std::min(turn - first, kMovedPart), kMovedPart);
      launchDueAfterWaiting(dueContext(), {queue_.ids() + first, part}, stream());
    }
    queue_.drop(turn, stream());
  }

  /// Reserves room for more items, as many as fit, but at least `at_least` or all. @return how many
  std::uint32_t takeRoom(std::uint32_t wanted, std::uint32_t at_least) {
    const std::uint32_t least = std::min(wanted, at_least);
    if (items_ + least > due_.capacity()) items_ = counters_.read(stream()).search.due;
    if (items_ + least > due_.capacity()) evaluate();
    const std::uint32_t taken = std::min(wanted, due_.capacity() - items_);
    items_ += taken;
    return taken;
  }

  /// Evaluates what is due so far.
  void evaluate() {
    const std::uint32_t busy = counters_.read(stream()).search.busy;
    const Stopwatch scoring;
    const DueWork work = {points_.view(), evaluation_, due_.ordered(points_.view().index, busy, stream()),
                          &counters_.data()->outcome};
    launchDueSearch(work, search_, busy, {stream(), context_->priorityStream(), fork_.get(), join_.get()});
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    score_ms_ += scoring.milliseconds();
    items_ = 0;
  }

  /// Makes room for neighbourhoods before the host knows how many: about as many as last time. Without memory update()
  /// finds them, which only costs time. @return how many fit
  std::uint32_t growPrepared() {
    const std::uint32_t expected = std::min(last_moved_ + last_moved_ / 8, kMaxPrepared);
    try {
      points_.growFound(expected);
      prepared_.growWithRoom(memory_, expected, std::min<std::size_t>(roomFor(expected), kMaxPrepared), 0);
    } catch (const ResourceLimit&) {
      return 0;
    }
    return expected;
  }

  void reset() {
    counters_.clear(stream());
    moved_.clear(stream());
    neighbours_begun_ = false;
  }

  std::shared_ptr<DeviceContext> context_;
  CountedMemory memory_;
  OwnedEvent fork_{cudaEventDisableTiming}, join_{cudaEventDisableTiming};  ///< for the search
  OwnedEvent moved_found_{cudaEventDisableTiming}, busy_made_{cudaEventDisableTiming};
  DeviceCounters counters_;
  PointTables points_;
  MovedTables moved_;
  FootprintTable footprint_;
  KnownTables known_;
  FlipTables flips_;
  DueLists due_;
  BusyTable busy_;
  WorkQueue queue_;                      ///< only with a budget
  DeviceArray<Neighbourhood> prepared_;  ///< of the first moved points, by findNeighbours()
  int multiprocessors_ = 1;
  bool any_known_ = false;         ///< whether any point has a neighbourhood
  bool neighbours_begun_ = false;  ///< for what was admitted since the last update
  std::uint32_t last_moved_ = 0;
  // For the update in progress.
  EvaluationView evaluation_;
  DueSearch search_;
  std::uint32_t taken_ = 0;  ///< number of moved points that have taken over their neighbourhoods
  std::uint32_t items_ = 0;  ///< upper bound of the items listed
  double score_ms_ = 0;
};

}  // namespace

std::unique_ptr<ExactUpdater> makeExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                               const ExactTables& tables) {
  const CurrentDevice current(context->device());
  return std::make_unique<DeviceExactUpdater>(std::move(context), memory, tables);
}

}  // namespace accessvdb::kernels
