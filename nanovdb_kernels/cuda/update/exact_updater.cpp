// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/updaters.h"

#include <algorithm>
#include <bit>
#include <vector>

#include "cuda/memory/address_range.h"
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/owned_event.h"
#include "cuda/memory/staging.h"
#include "cuda/update/device_counters.h"
#include "cuda/update/flip_tables.h"
#include "cuda/update/point_tables.h"
#include "cuda/update/update_kernels.h"
#include "cuda/update/work_queue.h"
#include "launch/counted_memory.h"
#include "launch/stopwatch.h"

namespace accessvdb::kernels {
namespace {

/// Points whose neighbours are found at a time, points looked at for flips at a time at least, and most items at a
/// time.
constexpr std::uint32_t kMovedPart = PointTables::kPart, kFlipsPart = 1u << 18, kMostItems = 3u << 19;
/// Most neighbourhoods that are found before the host knows how many there will be.
constexpr std::uint32_t kMostPrepared = 1u << 20;

/// Addresses for what is known of points: of 300 million at 180 directions. Memory comes as they grow, and nothing is
/// copied then: of all that is kept by point this is the most.
constexpr std::uint64_t kKnownAddresses = std::uint64_t{1} << 36;
/// Collisions are counted up to this many times the limit, to remember them. Counting farther did not pay.
constexpr int kCountTo = 2;
/// Shared memory that a block gets without asking.
constexpr int kPlainSharedBytes = 44 * 1024;

class ExactUpdater final : public PointUpdater {
 public:
  ExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const UpdaterTables& tables)
      : context_(std::move(context)),
        memory_(memory),
        counters_(memory_, stream()),
        points_(memory_, tables, view_),
        queue_(memory_),
        flips_(memory_) {
    loadFootprint(tables);
    loadCellDirections(tables);
    view_.counters = counters_.data();
    ACCESSVDB_CUDA(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, context_->device()));
  }

  void begin(const UpdateInput& input) override {
    const CurrentDevice current(context_->device());
    view_.points = input.points;
    view_.approach = input.approach;
    view_.update_rule = input.rule;
    const int limit = input.tool.collision_limit;
    view_.known.of = KnownLevels::of(limit);
    view_.known.count_to = std::min(kCountTo * limit, int{kNoScore});
    flips_.take(input.flips, view_, counters_, stream());
  }

  void admit(const AdmitInput& input) override {
    const CurrentDevice current(context_->device());
    if (neighbours_begun_) reset();
    const std::uint32_t first_place = any_known_ ? growPlaces(static_cast<std::uint32_t>(input.news.size())) : kNoIndex;
    points_.grow(input, view_, stream());
    growPoints(input.num_points);
    growBlocks(input.num_blocks);
    if (known_levels_ != nullptr) {
      growFilled(known_freed_, memory_, std::size_t{input.num_groups} * static_cast<std::size_t>(view_.known.words), 0,
                 stream());
      view_.known.freed = known_freed_.data();
    }
    points_.admit(input, first_place, view_, stream());
  }

  void findNeighbours() override {
    const CurrentDevice current(context_->device());
    neighbours_begun_ = true;
    launchFindMoved(view_, std::min(places_used_, view_.index.blocks), stream());
    const std::uint32_t most = growPrepared();
    for (std::uint32_t first = 0; first < most; first += kMovedPart) {
      points_.makeNeighbourhoods(view_, first, std::min(most - first, kMovedPart), prepared_.data() + first, stream());
    }
    launchNotePrepared(view_, most, stream());
    ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
  }

  void choose(const UpdateInput& input) override {
    const CurrentDevice current(context_->device());
    view_.points = input.points;
    flips_.addGroups(view_, stream());
    if (input.budget_points > 0) queue_.grow(view_.num_points, stream());
    view_.waiting = input.budget_points > 0 ? queue_.flags() : nullptr;
    if (!neighbours_begun_) {
      launchFindMoved(view_, std::min(places_used_, view_.index.blocks), stream());
      ACCESSVDB_CUDA(cudaEventRecord(moved_found_.get(), stream()));
    }
    const UpdateCounters found = prepareSearch(input);
    takeMoved(0, found.prepared, true);
    takeMoved(found.prepared, found.moved, false);
    taken_ = found.moved;
    if (view_.affected == nullptr) return;
    for (std::uint32_t first = 0, part = 0; first < view_.num_points; first += part) {
      part = takeRoom(view_.num_points - first, kFlipsPart);
      launchDueByFlips(view_, first, part, stream());
    }
  }

  UpdateOutcome update(const UpdateInput& input) override {
    const CurrentDevice current(context_->device());
    points_.setWeights(input.weights, view_, stream());
    const PointWeight* crossed = crossed_.send(input.crossed, memory_, stream());
    launchAddCrossed(view_, crossed, static_cast<std::uint32_t>(input.crossed.size()), stream());
    const std::uint32_t moved = counters_.read(stream()).moved;
    takeMoved(taken_, moved, false);
    if (input.budget_points > 0) takeTurn(input.budget_points);
    evaluate();
    const UpdateCounters done = counters_.read(stream());
    any_known_ = any_known_ || moved > 0;
    last_moved_ = moved;
    reset();
    requireNeighbours(done);
    UpdateOutcome outcome;
    outcome.moved = done.moved;
    outcome.evaluated = done.evaluated;
    outcome.scored = done.scored;
    outcome.tests = done.tests;
    outcome.label_changes = done.label_changes;
    outcome.waiting = queue_.size();
    outcome.score_ms = std::exchange(score_ms_, 0.0);
    return outcome;
  }

  std::uint64_t bytes() const override {
    return memory_.bytes() + (known_levels_ != nullptr ? known_levels_->backedBytes() : 0);
  }

 private:
  [[nodiscard]] cudaStream_t stream() const { return context_->stream(); }

  /// Without memory for the table nothing is remembered, which costs time only.
  void loadCellDirections(const UpdaterTables& tables) {
    if (tables.cell_directions.empty()) return;
    try {
      cell_directions_.grow(memory_, tables.cell_directions.size(), 0);
    } catch (const ResourceLimit&) {
      return;
    }
    cell_directions_.upload(tables.cell_directions.data(), tables.cell_directions.size());
    view_.covering.table = cell_directions_.data();
    std::copy_n(tables.cell_low, 3, view_.covering.low);
    std::copy_n(tables.cell_size, 3, view_.covering.size);
    view_.known.words = (tables.num_directions + kKnownPerWord - 1) / kKnownPerWord;
    known_levels_ = std::make_unique<AddressRange>(context_, kKnownAddresses);
  }

  void loadFootprint(const UpdaterTables& tables) {
    FootprintView& footprint = view_.footprint;
    for (const std::span<const FootprintColumn> columns : {tables.tool_columns, tables.arm_columns}) {
      for (const FootprintColumn& c : columns) {
        const std::int32_t low[3] = {c.dx, c.dy, c.z_low}, high[3] = {c.dx, c.dy, c.z_high};
        for (int axis = 0; axis < 3; ++axis) {
          footprint.low[axis] = std::min(footprint.low[axis], low[axis]);
          footprint.high[axis] = std::max(footprint.high[axis], high[axis]);
        }
      }
    }
    const auto side = static_cast<std::size_t>(footprint.high[1] - footprint.low[1] + 1);
    std::vector<FootprintPlace> places(static_cast<std::size_t>(footprint.high[0] - footprint.low[0] + 1) * side);
    const auto placeOf = [&](const FootprintColumn& c) -> FootprintPlace& {
      return places[static_cast<std::size_t>(c.dx - footprint.low[0]) * side +
                    static_cast<std::size_t>(c.dy - footprint.low[1])];
    };
    std::uint32_t number = 0;
    for (const FootprintColumn& c : tables.tool_columns) placeOf(c).tool = ++number;
    number = 0;
    for (const FootprintColumn& c : tables.arm_columns) placeOf(c).arm = ++number;
    const auto load = [&](auto& to, const auto& from) {
      to.grow(memory_, from.size(), 0);
      to.upload(from.data(), from.size());
    };
    load(tool_columns_, tables.tool_columns);
    load(arm_columns_, tables.arm_columns);
    load(footprint_places_, places);
    footprint.tool = tool_columns_.data();
    footprint.arm = arm_columns_.data();
    footprint.places = footprint_places_.data();
  }

  void fill(void* to, int byte, std::size_t bytes) const { fillBytes(to, byte, bytes, stream()); }
  /// Places of touched points. @return the first of `more` new ones
  std::uint32_t growPlaces(std::uint32_t more) {
    const std::uint32_t first = places_used_;
    places_used_ += more;
    places_.growWithRoom(memory_, places_used_, roomFor(places_used_), first);
    view_.places.places = places_.data();
    return first;
  }

  void growPoints(std::uint32_t points) {
    if (known_levels_ != nullptr) {
      known_levels_->back(std::uint64_t{points} * static_cast<std::uint64_t>(view_.known.words) *
                          sizeof(std::uint64_t));
      view_.known.levels = static_cast<std::uint64_t*>(known_levels_->base());
    }
    growFilled(moved_, memory_, points, 0, stream());
    growFilled(moved_bits_, memory_, points / 32 + 1, 0, stream());
    growFilled(changed_bits_, memory_, points / 32 + 1, 0, stream());
    view_.moved = moved_.data();
    view_.state.moved_bits = moved_bits_.data();
    view_.state.changed_bits = changed_bits_.data();
  }

  void growBlocks(std::uint32_t blocks) {
    growFilled(touched_blocks_, memory_, blocks, 0, stream());
    growFilled(reached_blocks_, memory_, blocks, 0, stream());
    growFilled(head_, memory_, blocks, 0xff, stream());
    growFilled(due_heads_, memory_, blocks, 0xff, stream());
    growFilled(busy_blocks_, memory_, blocks, 0, stream());
    growFilled(reached_bits_, memory_, blocks / 32 + 1, 0, stream());
    view_.places.head = head_.data();
    view_.places.touched_blocks = touched_blocks_.data();
    view_.places.reached_bits = reached_bits_.data();
    view_.places.reached_blocks = reached_blocks_.data();
  }

  /// Whatever searches read, from the voxel of a point: the tool, whole slabs of it, and the corridor.
  [[nodiscard]] VoxelBox reachOfSearch() const {
    constexpr std::int32_t kSlabs = 16;  // they go beyond the lowest and the highest voxel
    const std::int32_t from_group = (8 << view_.groups.log2) - 1;
    VoxelBox reach;
    for (int axis = 0; axis < 3; ++axis) {
      reach.low[axis] = 8 * view_.footprint.low[axis] - from_group - (axis == 2 ? kSlabs : 0);
      reach.high[axis] = 8 * view_.footprint.high[axis] + 7 + (axis == 2 ? kSlabs : 0);
    }
    return reach;
  }

  /// Of this update. It needs the mirror, and that the moved points are found; after findNeighbours() it runs beside
  /// what begin() has the device do, which may take longer.
  /// @return with those points counted
  UpdateCounters prepareSearch(const UpdateInput& input) {
    const cudaStream_t beside = context_->mirrorStream();
    ACCESSVDB_CUDA(cudaStreamWaitEvent(beside, moved_found_.get()));
    launchCountLowers(input.map.grid, &counters_.data()->lowers, beside);
    const UpdateCounters found = counters_.read(beside);
    search_ = {};
    search_.map = input.map;
    search_.tool = input.tool;
    search_.multiprocessors = multiprocessors_;
    search_.slabs = input.slabs;
    search_.tool.reach = reachOfSearch();
    // More than what a block gets without asking would be taken from the cache; each node takes two entries.
    search_.window = planWindow(search_.tool, kPlainSharedBytes / BusyMapView::kEntries, false);
    search_.busy = makeBusyMap(input.map.grid, found.lowers, beside);
    ACCESSVDB_CUDA(cudaEventRecord(busy_made_.get(), beside));
    ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), busy_made_.get()));
    growItems();
    items_ = 0;
    return found;
  }

  /// What is due of the moved points [begin, end). @param prepared  findNeighbours() made their neighbourhoods
  void takeMoved(std::uint32_t begin, std::uint32_t end, bool prepared) {
    if (!prepared && begin < end) points_.growParts(end - begin);
    for (std::uint32_t first = begin, part = 0; first < end; first += part) {
      part = takeRoom(std::min(end - first, kMovedPart), kMovedPart);
      const Neighbourhood* of_part =
          prepared ? prepared_.data() + first : points_.makeNeighbourhoods(view_, first, part, stream());
      launchTakeNeighbours(view_, first, part, of_part, stream());
    }
  }

  /// What is due of the first ones in the queue.
  void takeTurn(std::uint32_t budget_points) {
    queue_.addFrom(view_.num_points, {kAsked, kAsked}, stream());
    const std::uint32_t turn = std::min(queue_.size(), budget_points);
    for (std::uint32_t first = 0, part = 0; first < turn; first += part) {
      part = takeRoom(std::min(turn - first, kMovedPart), kMovedPart);
      launchDueOfWaiting(view_, queue_.ids() + first, part, stream());
    }
    queue_.drop(turn, stream());
  }

  /// For more items, which are about to come: as many as there is room for, but at least this many or all.
  std::uint32_t takeRoom(std::uint32_t wanted, std::uint32_t at_least) {
    const std::uint32_t least = std::min(wanted, at_least);
    if (items_ + least > due_.size()) items_ = counters_.read(stream()).due;
    if (items_ + least > due_.size()) evaluate();
    const std::uint32_t taken = std::min(wanted, static_cast<std::uint32_t>(due_.size()) - items_);
    items_ += taken;
    return taken;
  }

  /// What is due so far.
  void evaluate() {
    const std::uint32_t busy = counters_.read(stream()).busy;
    const Stopwatch scoring;
    UpdateView view = view_;
    view.due.busy = orderBusy(busy);
    launchDueSearch(view, search_, busy, {stream(), context_->mirrorStream(), fork_.get(), join_.get()});
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    score_ms_ += scoring.milliseconds();
    items_ = 0;
  }

  /// Points that are near are searched at the same time, as they read the same of the map.
  /// @return the blocks with anything due, in the order of the search
  std::uint32_t* orderBusy(std::uint32_t blocks) {
    if (blocks == 0) return view_.due.busy;
    for (auto* list : {&busy_keys_, &busy_sorted_, &busy_order_}) {
      list->growWithRoom(memory_, blocks, roomFor(blocks), 0);
    }
    const auto order = [&](void* scratch, std::size_t& bytes) {
      launchBlockOrder(view_.index.leaf, view_.due.busy, blocks, busy_keys_.data(), busy_sorted_.data(),
                       busy_order_.data(), scratch, bytes, stream());
    };
    std::size_t bytes = 0;
    order(nullptr, bytes);
    busy_scratch_.growWithRoom(memory_, bytes, roomFor(bytes), 0);
    order(busy_scratch_.data(), bytes);
    return busy_order_.data();
  }

  /// @param lowers  lower nodes of the mirror
  BusyMapView makeBusyMap(const OccupancyGrid* grid, std::uint32_t lowers, cudaStream_t beside) {
    const std::size_t slots = std::bit_ceil(2 * std::size_t{lowers} + 64);
    lower_keys_.grow(memory_, slots, 0);
    lower_numbers_.grow(memory_, slots, 0);
    lower_nodes_.growWithRoom(memory_, lowers, roomFor(lowers), 0);
    busy_bits_.growWithRoom(memory_, BusyMapView::kColumns * std::size_t{lowers},
                            BusyMapView::kColumns * roomFor(lowers), 0);
    fillBytes(lower_keys_.data(), 0xff, slots * sizeof(std::uint64_t), beside);
    const BusyMapView busy = {{lower_keys_.data(), static_cast<std::uint32_t>(slots - 1)},
                              lower_numbers_.data(),
                              lower_nodes_.data(),
                              busy_bits_.data()};
    launchBusyMap(grid, busy, lowers, &counters_.data()->listed_lowers, beside);
    return busy;
  }

  /// Room for neighbourhoods before the host knows how many there will be: about as many as last time. Without memory
  /// update() finds them, which costs time only. @return for how many there is room
  std::uint32_t growPrepared() {
    const std::uint32_t expected = std::min(last_moved_ + last_moved_ / 8, kMostPrepared);
    try {
      points_.growFound(expected);
      prepared_.growWithRoom(memory_, expected, std::min<std::size_t>(roomFor(expected), kMostPrepared), 0);
    } catch (const ResourceLimit&) {
      return 0;
    }
    return expected;
  }

  void growItems() {
    // Room for all points, for small maps; else for parts of them, of which few are due.
    const std::size_t items = std::clamp<std::size_t>(roomFor(view_.num_points), kFlipsPart, kMostItems);
    if (due_.size() < items) {
      due_.grow(memory_, items, 0);
      due_order_.grow(memory_, items, 0);
      due_whole_.grow(memory_, items, 0);
    }
    view_.due = {due_.data(), due_heads_.data(), busy_blocks_.data(), due_order_.data(), due_whole_.data()};
  }

  void reset() {
    counters_.clear(stream());
    fill(moved_bits_.data(), 0, moved_bits_.bytes());
    fill(changed_bits_.data(), 0, changed_bits_.bytes());
    fill(reached_bits_.data(), 0, reached_bits_.bytes());
    fill(head_.data(), 0xff, head_.bytes());
    places_used_ = 0;
    neighbours_begun_ = false;
  }

  std::shared_ptr<DeviceContext> context_;
  CountedMemory memory_;
  OwnedEvent fork_{cudaEventDisableTiming}, join_{cudaEventDisableTiming};  ///< of the search
  OwnedEvent moved_found_{cudaEventDisableTiming}, busy_made_{cudaEventDisableTiming};
  UpdateView view_;
  DeviceCounters counters_;
  PointTables points_;
  WorkQueue queue_;  ///< only with a budget
  int multiprocessors_ = 1;
  bool any_known_ = false;         ///< does any point have a neighbourhood?
  bool neighbours_begun_ = false;  ///< of what was admitted since the last update
  std::uint32_t places_used_ = 0, last_moved_ = 0;
  // Of the update at work.
  std::uint32_t taken_ = 0;  ///< of the moved points, the first: their neighbourhoods are theirs
  DueSearch search_;
  std::uint32_t items_ = 0;  ///< at least as many as there are
  double score_ms_ = 0;

  DeviceArray<FootprintColumn> tool_columns_, arm_columns_;
  DeviceArray<FootprintPlace> footprint_places_;
  DeviceArray<DirectionArc> cell_directions_;
  FlipTables flips_;
  // By id.
  DeviceArray<std::uint32_t> moved_bits_, changed_bits_, moved_;
  std::unique_ptr<AddressRange> known_levels_;  ///< null: nothing is remembered
  // By block.
  DeviceArray<std::uint32_t> head_, touched_blocks_, reached_bits_, reached_blocks_, due_heads_, busy_blocks_;
  // By group.
  DeviceArray<FreedWord> known_freed_;
  // Of one update.
  DeviceArray<Place> places_;
  DeviceArray<std::uint64_t> lower_keys_;
  DeviceArray<std::uint32_t> lower_numbers_, lower_nodes_;
  DeviceArray<std::uint16_t> busy_bits_;
  DeviceArray<Neighbourhood> prepared_;  ///< of the first ones of the moved points, by findNeighbours()
  DeviceArray<DueItem> due_;
  DeviceArray<std::uint32_t> due_order_, due_whole_, busy_keys_, busy_sorted_, busy_order_;
  DeviceArray<std::byte> busy_scratch_;
  Staging<PointWeight> crossed_;
};

}  // namespace

std::unique_ptr<PointUpdater> makeExactUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                               const UpdaterTables& tables) {
  const CurrentDevice current(context->device());
  return std::make_unique<ExactUpdater>(std::move(context), memory, tables);
}

}  // namespace accessvdb::kernels
