// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/cuda_updater.h"

#include <algorithm>
#include <bit>
#include <chrono>

#include "accessvdb/error.h"
#include "cuda/address_range.h"
#include "cuda/cuda_check.h"
#include "cuda/device_counters.h"
#include "cuda/flip_tables.h"
#include "cuda/growing.h"
#include "cuda/owned_event.h"
#include "cuda/staging.h"
#include "cuda/update_kernels.h"

namespace accessvdb::kernels {
namespace {

/// Points whose neighbours are found at a time, points looked at for flips at a time, and most items that wait.
constexpr std::uint32_t kMovedPart = 1u << 17, kFlipsPart = 1u << 18, kMostItems = 3u << 19;
/// Most neighbourhoods that are found before the host knows how many there will be.
constexpr std::uint32_t kMostPrepared = 1u << 20;

/// Addresses for what is known of points: of 300 million at 180 directions. Memory comes as they grow, and nothing is
/// copied then: of all that is kept by point this is the most.
constexpr std::uint64_t kKnownAddresses = std::uint64_t{1} << 36;
/// Collisions are counted up to this many times the limit, to remember them. Counting farther did not pay.
constexpr int kCountTo = 2;
/// Shared memory that a block gets without asking.
constexpr int kPlainSharedBytes = 44 * 1024;

double millisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

class CudaUpdater final : public PointUpdater {
 public:
  CudaUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const UpdaterTables& tables)
      : context_(std::move(context)), memory_(memory), counters_(memory, stream()), flips_(memory) {
    const auto load = [&](DeviceArray<FootprintColumn>& to, std::span<const FootprintColumn> from) {
      to.grow(memory_, from.size(), 0);
      to.upload(from.data(), from.size());
    };
    load(tool_columns_, tables.tool_columns);
    load(arm_columns_, tables.arm_columns);
    view_.footprint = {tool_columns_.data(), arm_columns_.data(),
                       static_cast<std::uint32_t>(tables.tool_columns.size()),
                       static_cast<std::uint32_t>(tables.arm_columns.size())};
    for (const std::span<const FootprintColumn> columns : {tables.tool_columns, tables.arm_columns}) {
      for (const FootprintColumn& c : columns) includeColumn(c);
    }
    loadCellDirections(tables);
    view_.groups.log2 = tables.group_log2;
    view_.rule.voxel_size_m = static_cast<float>(tables.voxel_size_m);
    view_.rule.inverse_voxel_size = 1.0 / tables.voxel_size_m;
    view_.rule.steps_per_m = neighbourStepsPerMetre(tables.radius_m);
    view_.rule.radius_squared = neighbourRadiusSquared(tables.radius_m);
    view_.rule.neighbours = tables.neighbours;
    view_.rule.view_neighbours = tables.view_neighbours;
    words_ = static_cast<std::size_t>((tables.num_directions + 63) / 64);
    ACCESSVDB_CUDA(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, context_->device()));
  }

  void begin(const UpdateInput& input) override {
    const CurrentDevice current(context_->device());
    refreshView(input.points, view_.num_points);
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
    growPoints(input.num_points);
    growBlocks(input.num_blocks, input.num_slots);
    growGroups(input.num_groups);
    const auto news_count = static_cast<std::uint32_t>(input.news.size());
    const std::uint32_t first_place = any_known_ ? places_used_ : kNoIndex;
    if (any_known_) {
      places_used_ += news_count;
      places_.growWithRoom(memory_, places_used_, roomFor(places_used_), places_used_ - news_count);
    }
    refreshView(input.points, input.num_points);
    const BlockNews* blocks = blocks_news_.send(input.blocks, memory_, stream());
    const std::uint32_t* ids = ids_news_.send(input.block_ids, memory_, stream());
    launchAdmitBlocks(view_, blocks, ids, static_cast<std::uint32_t>(input.blocks.size()), stream());
    const PointNews* news = news_.send(input.news, memory_, stream());
    launchAdmitPoints(view_, news, news_count, first_place, stream());
  }

  void findNeighbours() override {
    const CurrentDevice current(context_->device());
    neighbours_begun_ = true;
    launchFindMoved(view_, std::min(places_used_, view_.index.blocks), stream());
    const std::uint32_t most = growPrepared();
    for (std::uint32_t first = 0; first < most; first += kMovedPart) {
      makeNeighbourhoods(first, std::min(most - first, kMovedPart), prepared_.data() + first);
    }
    launchNotePrepared(view_, most, stream());
  }

  UpdateOutcome update(const UpdateInput& input) override {
    const CurrentDevice current(context_->device());
    refreshView(input.points, view_.num_points);
    flips_.addGroups(view_, stream());
    const PointWeight* weights = weights_.send(input.weights, memory_, stream());
    launchSetWeights(view_, weights, static_cast<std::uint32_t>(input.weights.size()), stream());
    if (!neighbours_begun_) launchFindMoved(view_, std::min(places_used_, view_.index.blocks), stream());
    const PointWeight* crossed = crossed_.send(input.crossed, memory_, stream());
    launchAddCrossed(view_, crossed, static_cast<std::uint32_t>(input.crossed.size()), stream());
    ACCESSVDB_CUDA(cudaStreamWaitEvent(stream(), context_->mirrorReady()));
    launchCountLowers(input.map.grid, counters_.data(), stream());
    const UpdateCounters found = counters_.read(stream());
    const std::uint32_t moved = found.moved;

    DueSearch search;
    search.map = input.map;
    search.tool = input.tool;
    search.multiprocessors = multiprocessors_;
    search.slabs = input.slabs;
    search.tool.reach = reachOfSearch();
    // More than what a block gets without asking would be taken from the cache; each node takes two entries.
    search.window = planWindow(search.tool, kPlainSharedBytes / BusyMapView::kEntries, false);
    search.busy = makeBusyMap(input.map.grid, found.lowers);
    growItems();
    growForParts(found_, moved - found.prepared);
    growForParts(part_, moved - found.prepared);
    UpdateOutcome outcome;
    const auto evaluate = [&] {
      ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
      const auto begin = std::chrono::steady_clock::now();
      launchDueSearch(view_, search, view_.index.blocks,
                      {stream(), context_->mirrorStream(), fork_.get(), join_.get()});
      ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
      outcome.score_ms += millisecondsSince(begin);
    };
    std::uint32_t waiting = 0;  // at least as many as there are items
    const auto makeRoom = [&](std::uint32_t more) {
      if (waiting + more <= due_.size()) return;
      const UpdateCounters now = counters_.read(stream());
      waiting = now.due;
      if (waiting + more <= due_.size()) return;
      evaluate();
      waiting = 0;
    };
    for (std::uint32_t first = 0, part = 0; first < moved; first += part) {
      const bool prepared = first < found.prepared;
      part = std::min((prepared ? found.prepared : moved) - first, kMovedPart);
      makeRoom(part);
      if (!prepared) makeNeighbourhoods(first, part, part_.data());
      launchTakeNeighbours(view_, first, part, prepared ? prepared_.data() + first : part_.data(), stream());
      waiting += part;
    }
    if (view_.affected != nullptr) {
      for (std::uint32_t first = 0; first < view_.num_points; first += kFlipsPart) {
        const std::uint32_t part = std::min(view_.num_points - first, kFlipsPart);
        makeRoom(part);
        launchDueByFlips(view_, first, part, stream());
        waiting += part;
      }
    }
    evaluate();
    const UpdateCounters done = counters_.read(stream());
    any_known_ = any_known_ || moved > 0;
    last_moved_ = moved;
    reset();
    if (done.failed != 0) {
      throw InternalError("update.neighbours", "cuda", "more points at one distance than a map can hold",
                          "Please report this, and use --device cpu");
    }
    outcome.moved = done.moved;
    outcome.evaluated = done.evaluated;
    outcome.scored = done.scored;
    outcome.tests = done.tests;
    outcome.label_changes = done.label_changes;
    return outcome;
  }

  std::uint64_t bytes() const override {
    return tool_columns_.bytes() + arm_columns_.bytes() + counters_.bytes() + block_.bytes() + mean_.bytes() +
           to_sensor_.bytes() + own_seen_.bytes() + reach_.bytes() + moved_bits_.bytes() + changed_bits_.bytes() +
           moved_.bytes() + hash_keys_.bytes() + hash_blocks_.bytes() + leaf_.bytes() + first_.bytes() +
           count_.bytes() + ids_.bytes() + block_reach_.bytes() + head_.bytes() + touched_blocks_.bytes() +
           reached_bits_.bytes() + reached_blocks_.bytes() + places_.bytes() + found_.bytes() + part_.bytes() +
           prepared_.bytes() + due_.bytes() + due_heads_.bytes() + due_order_.bytes() + due_whole_.bytes() +
           busy_blocks_.bytes() + news_.bytes() + blocks_news_.bytes() + ids_news_.bytes() + weights_.bytes() +
           crossed_.bytes() + flips_.bytes() + (known_levels_ != nullptr ? known_levels_->backedBytes() : 0) +
           known_freed_.bytes() + cell_directions_.bytes() + lower_keys_.bytes() + lower_numbers_.bytes() +
           lower_nodes_.bytes() + busy_bits_.bytes() + group_of_.bytes() + group_leaf_.bytes() + with_points_.bytes();
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

  void includeColumn(const FootprintColumn& c) {
    const std::int32_t low[3] = {c.dx, c.dy, c.z_low}, high[3] = {c.dx, c.dy, c.z_high};
    for (int axis = 0; axis < 3; ++axis) {
      view_.footprint.low[axis] = std::min(view_.footprint.low[axis], low[axis]);
      view_.footprint.high[axis] = std::max(view_.footprint.high[axis], high[axis]);
    }
  }
  void fill(void* to, int byte, std::size_t bytes) const { fillBytes(to, byte, bytes, stream()); }
  /// Grows an array, keeps all of it, and fills what is new.
  template <typename T>
  void growFilled(DeviceArray<T>& array, std::size_t size, int byte) {
    if (size <= array.size()) return;
    const std::size_t before = array.size();
    array.growWithRoom(memory_, size, roomFor(size), before);
    fill(array.data() + before, byte, (array.size() - before) * sizeof(T));
  }

  void growPoints(std::uint32_t points) {
    const std::size_t kept = view_.num_points;
    const auto grow = [&](auto& array, std::size_t each) {
      array.growWithRoom(memory_, points * each, roomFor(points) * each, kept * each);
    };
    grow(block_, 1);
    grow(mean_, 3);
    grow(to_sensor_, 3);
    grow(own_seen_, words_);
    grow(reach_, 1);
    if (known_levels_ != nullptr) {
      known_levels_->back(std::uint64_t{points} * static_cast<std::uint64_t>(view_.known.words) *
                          sizeof(std::uint64_t));
    }
    growFilled(moved_, points, 0);
    growFilled(moved_bits_, points / 32 + 1, 0);
    growFilled(changed_bits_, points / 32 + 1, 0);
  }

  void growBlocks(std::uint32_t blocks, std::uint32_t slots) {
    const std::size_t kept = view_.index.blocks;
    const auto grow = [&](auto& array, std::size_t each) {
      array.growWithRoom(memory_, blocks * each, roomFor(blocks) * each, kept * each);
    };
    grow(leaf_, 3);
    grow(first_, 1);
    grow(count_, 1);
    grow(block_reach_, 1);
    grow(group_of_, 1);
    growFilled(touched_blocks_, blocks, 0);
    growFilled(reached_blocks_, blocks, 0);
    growFilled(head_, blocks, 0xff);
    growFilled(due_heads_, blocks, 0xff);
    growFilled(busy_blocks_, blocks, 0);
    growFilled(reached_bits_, blocks / 32 + 1, 0);
    growFilled(ids_, slots, 0);
    if (hash_keys_.size() < 2 * std::size_t{blocks}) {
      const std::size_t capacity = std::bit_ceil(std::size_t{4} * blocks + 1024);
      hash_keys_ = DeviceArray<std::uint64_t>();
      hash_blocks_ = DeviceArray<std::uint32_t>();
      hash_keys_.grow(memory_, capacity, 0);
      hash_blocks_.grow(memory_, capacity, 0);
      fill(hash_keys_.data(), 0xff, hash_keys_.bytes());
      refreshIndex(static_cast<std::uint32_t>(kept));
      launchRehash(view_.index, stream());
    }
    refreshIndex(blocks);
  }

  void refreshIndex(std::uint32_t blocks) {
    view_.index.hash = {hash_keys_.data(), static_cast<std::uint32_t>(hash_keys_.size() - 1)};
    view_.index.block_at = hash_blocks_.data();
    view_.index.leaf = leaf_.data();
    view_.index.first = first_.data();
    view_.index.count = count_.data();
    view_.index.ids = ids_.data();
    view_.index.reach_m = block_reach_.data();
    view_.index.blocks = blocks;
    view_.groups.of_block = group_of_.data();
  }

  void growGroups(std::uint32_t groups) {
    growFilled(with_points_, groups, 0);
    growFilled(group_leaf_, std::size_t{3} * groups, 0);
    growFilled(known_freed_, std::size_t{groups} * static_cast<std::size_t>(view_.known.words), 0);
    view_.groups.with_points = with_points_.data();
    view_.groups.leaf = group_leaf_.data();
    view_.groups.groups = groups;
  }

  void refreshView(const PointStateView& points, std::uint32_t num_points) {
    view_.points = points;
    view_.num_points = num_points;
    view_.state = {block_.data(), mean_.data(),       to_sensor_.data(),   own_seen_.data(),
                   reach_.data(), moved_bits_.data(), changed_bits_.data()};
    view_.known.levels = known_levels_ != nullptr ? static_cast<std::uint64_t*>(known_levels_->base()) : nullptr;
    view_.known.freed = known_freed_.data();
    view_.places = {places_.data(), head_.data(), touched_blocks_.data(), reached_bits_.data(), reached_blocks_.data()};
    view_.moved = moved_.data();
    view_.counters = counters_.data();
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

  /// @param lowers  lower nodes of the mirror
  BusyMapView makeBusyMap(const OccupancyGrid* grid, std::uint32_t lowers) {
    const std::size_t slots = std::bit_ceil(2 * std::size_t{lowers} + 64);
    lower_keys_.grow(memory_, slots, 0);
    lower_numbers_.grow(memory_, slots, 0);
    lower_nodes_.growWithRoom(memory_, lowers, roomFor(lowers), 0);
    busy_bits_.growWithRoom(memory_, BusyMapView::kColumns * std::size_t{lowers},
                            BusyMapView::kColumns * roomFor(lowers), 0);
    fill(lower_keys_.data(), 0xff, slots * sizeof(std::uint64_t));
    const BusyMapView busy = {{lower_keys_.data(), static_cast<std::uint32_t>(slots - 1)},
                              lower_numbers_.data(),
                              lower_nodes_.data(),
                              busy_bits_.data()};
    launchBusyMap(grid, busy, lowers, counters_.data(), stream());
    return busy;
  }

  /// For parts of so many moved points.
  template <typename T>
  void growForParts(DeviceArray<T>& array, std::uint32_t moved) {
    const std::size_t part = std::min(moved, kMovedPart);
    if (array.size() < part) array.grow(memory_, std::min<std::size_t>(roomFor(part), kMovedPart), 0);
  }
  void makeNeighbourhoods(std::uint32_t first, std::uint32_t count, Neighbourhood* to) {
    launchNearest(view_, first, count, found_.data(), stream());
    launchMakeNeighbourhoods(view_, first, count, found_.data(), to, stream());
  }

  /// Room for neighbourhoods before the host knows how many there will be: about as many as last time. Without memory
  /// update() finds them, which costs time only. @return for how many there is room
  std::uint32_t growPrepared() {
    const std::uint32_t expected = std::min(last_moved_ + last_moved_ / 8, kMostPrepared);
    try {
      growForParts(found_, expected);
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
  DeviceMemory& memory_;
  OwnedEvent fork_{cudaEventDisableTiming}, join_{cudaEventDisableTiming};  ///< of the search
  UpdateView view_;
  std::size_t words_ = 1;
  int multiprocessors_ = 1;
  bool any_known_ = false;         ///< does any point have a neighbourhood?
  bool neighbours_begun_ = false;  ///< of what was admitted since the last update
  std::uint32_t places_used_ = 0, last_moved_ = 0;

  DeviceArray<FootprintColumn> tool_columns_, arm_columns_;
  DeviceArray<DirectionArc> cell_directions_;
  DeviceCounters counters_;
  FlipTables flips_;
  // By id.
  DeviceArray<std::uint32_t> block_, moved_bits_, changed_bits_, moved_;
  DeviceArray<float> mean_, to_sensor_, reach_;
  DeviceArray<std::uint64_t> own_seen_;
  std::unique_ptr<AddressRange> known_levels_;  ///< null: nothing is remembered
  // By block.
  DeviceArray<std::uint64_t> hash_keys_;
  DeviceArray<std::uint32_t> hash_blocks_, first_, count_, ids_, head_, touched_blocks_, reached_bits_, reached_blocks_,
      due_heads_, busy_blocks_, due_order_, due_whole_;
  DeviceArray<std::int32_t> leaf_;
  DeviceArray<float> block_reach_;
  DeviceArray<std::uint32_t> group_of_;
  // By group.
  DeviceArray<std::int32_t> group_leaf_;
  DeviceArray<std::uint8_t> with_points_;
  DeviceArray<FreedWord> known_freed_;
  // Of one update.
  DeviceArray<Place> places_;
  DeviceArray<std::uint64_t> lower_keys_;
  DeviceArray<std::uint32_t> lower_numbers_, lower_nodes_;
  DeviceArray<std::uint16_t> busy_bits_;
  DeviceArray<FoundNeighbours> found_;   ///< of a part of the moved points
  DeviceArray<Neighbourhood> part_;      ///< of the same part
  DeviceArray<Neighbourhood> prepared_;  ///< of the first ones of them, by findNeighbours()
  DeviceArray<DueItem> due_;
  Staging<PointNews> news_;
  Staging<BlockNews> blocks_news_;
  Staging<std::uint32_t> ids_news_;
  Staging<PointWeight> weights_, crossed_;
};

}  // namespace

std::unique_ptr<PointUpdater> makeCudaUpdater(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                              const UpdaterTables& tables) {
  const CurrentDevice current(context->device());
  return std::make_unique<CudaUpdater>(std::move(context), memory, tables);
}

}  // namespace accessvdb::kernels
