// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/fusion/scan_fuser.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

#include "accessvdb/error.h"
#include "cuda/fusion/fusion_views.h"
#include "cuda/memory/counters_on_device.h"
#include "cuda/memory/cuda_check.h"
#include "cuda/memory/device_context.h"
#include "cuda/memory/growing.h"
#include "cuda/memory/owned_event.h"
#include "cuda/memory/pinned_buffer.h"
#include "cuda/memory/range_array.h"
#include "cuda/memory/staging.h"
#include "hostdev/weight_window.h"
#include "launch/counted_memory.h"
#include "launch/scan_extent.h"
#include "launch/slot_counts.h"

namespace accessvdb::kernels {
namespace {

constexpr std::size_t kValues = 512, kCleared = 16, kVotes = 48;
constexpr std::uint64_t kSlotBytes = (kValues + kCleared + 3) * sizeof(std::uint32_t);  ///< with what says whose it is
/// Slots are added so many at a time, and values come from the host.
constexpr std::uint32_t kSlotsAtATime = 4096;
constexpr std::size_t kRecordsAtATime = 4096, kNamedAtATime = std::size_t{1} << 18;
constexpr std::size_t kVoxelsAtATime = std::size_t{1} << 18;  ///< whose weights are read
constexpr std::uint32_t kMostSlots = FusedLeaf::kFresh - 1;

using Origin = GridGrowth::Origin;
static_assert(sizeof(Origin) == 3 * sizeof(std::int32_t));

/// Slots of one kind, and which of them are free.
class SlotList {
 public:
  explicit SlotList(std::shared_ptr<DeviceContext> context) : free_(std::move(context)) {}

  [[nodiscard]] SlotsView view() const { return {free_.data(), counts_.free, counts_.next}; }
  [[nodiscard]] std::uint32_t count() const { return counts_.next; }
  [[nodiscard]] const SlotCounts& counts() const { return counts_; }
  /// @throws ResourceLimit
  void growFree(std::uint32_t slots) { free_.grow(slots); }
  void take(std::uint32_t needs) { counts_.take(needs); }
  /// They are on the list already.
  void giveBack(std::uint32_t count) { counts_.free += count; }
  [[nodiscard]] std::uint64_t bytes() const { return free_.bytes(); }

 private:
  RangeArray<std::uint32_t> free_;
  SlotCounts counts_;
};

class Implementation final : public DeviceScanFuser {
 public:
  Implementation(std::shared_ptr<DeviceContext> context, DeviceMemory& memory, const FusionSetting& setting,
                 const OccupancyGrid* grid)
      : context_(std::move(context)),
        memory_(memory),
        setting_(setting),
        // The device writes it.
        grid_(reinterpret_cast<std::byte*>(const_cast<OccupancyGrid*>(grid))),
        counters_(memory_, stream()),
        value_slots_(context_),
        vote_slots_(context_),
        values_(context_),
        cleared_(context_),
        owner_(context_),
        stamp_(context_),
        votes_(context_) {}

  void begin(const GridSpace& space, std::span<const Origin> with_values, std::span<const VotesRecord> votes) override {
    const CurrentDevice current(context_->device());
    // Another fuser may have written to the grid before.
    launchForgetSlots(grid_, space.uppers, stream());
    while (!with_values.empty()) {
      const std::size_t count = std::min(with_values.size(), kNamedAtATime);
      launchNoteOnHost(grid_, asked_.send(with_values.first(count), memory_, stream()), stream());
      with_values = with_values.subspan(count);
    }
    requireNumbers(votes.size());
    const auto slots = static_cast<std::uint32_t>(votes.size());
    vote_slots_.growFree(roundedSlots(slots));
    votes_.grow(roundedSlots(slots) * kVotes);
    Staging<VotesRecord> records;
    while (!votes.empty()) {
      const std::size_t count = std::min(votes.size(), kRecordsAtATime);
      launchTakeVotes(grid_, records.send(votes.first(count), memory_, stream()), votes_.data(), vote_slots_.count(),
                      stream());
      vote_slots_.take(static_cast<std::uint32_t>(count));
      votes = votes.subspan(count);
    }
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
  }

  FusedScan fuse(std::span<const ReturnRay> rays, std::uint32_t balls, const GridSpace& space, const Reserve& reserve,
                 FollowingMap& host) override {
    const CurrentDevice current(context_->device());
    ReachView scan = viewOf(rays, balls);
    ACCESSVDB_CUDA(cudaEventRecord(begun_.get(), stream()));
    counters_.clear(stream());
    launchCountPairs(scan, scratch_, stream());
    const std::uint32_t pairs = counters_.read(stream()).pairs;
    if (pairs > 0) {
      growPairs(pairs, scan);
      const std::uint64_t uppers =
          std::uint64_t{scan.key_space.size[0]} * scan.key_space.size[1] * scan.key_space.size[2];
      launchListLeaves(scan, pairs, LeafKeys::kUpperShift + std::bit_width(uppers - 1), scratch_, stream());
      launchFindLeaves(scan, pairs, stream());
      launchFindNeeds(scan, pairs, scratch_, stream());
    }
    // All that can fail for lack of memory comes before the first write to the map.
    FusionCounters most = counters_.read(stream());
    const std::uint64_t returned = most.missed;
    if (returned > 0) {
      takeMissed(scan, most, host);
      launchFindNeeds(scan, pairs, scratch_, stream());
      most = counters_.read(stream());
    }
    makeRoom(scan, most, space, reserve, host);
    ++scans_;
    if (pairs == 0) return {};
    launchAssignSlots(scan, most.leaves, value_slots_.view(), vote_slots_.view(), scratch_, stream());
    value_slots_.take(most.value_needs);
    vote_slots_.take(most.vote_needs);
    const FusionView fused = fusionOf(scan, most);
    launchFuseLeaves(fused, stream());
    launchPublishLeaves(scan, fused, growthOf(space), most, value_slots_.view(), vote_slots_.view(), cacheView(),
                        scans_, scratch_, stream());
    const FusionCounters done = counters_.read(stream());
    value_slots_.giveBack(done.freed_values);
    vote_slots_.giveBack(done.freed_votes);
    listFlips(fused, done);
    ACCESSVDB_CUDA(cudaEventRecord(ended_.get(), stream()));
    ACCESSVDB_CUDA(cudaEventRecord(context_->mirrorReady(), stream()));
    FusedScan fused_scan = outcomeOf(done);
    fused_scan.returned_leaves = returned;
    return fused_scan;
  }

  void readWeights(std::span<const Origin> voxels, int reach, std::span<std::uint16_t> weights,
                   FollowingMap& host) override {
    const CurrentDevice current(context_->device());
    for (std::size_t first = 0; first < voxels.size(); first += kVoxelsAtATime) {
      const std::size_t count = std::min(voxels.size() - first, kVoxelsAtATime);
      readSomeWeights(voxels.subspan(first, count), reach, weights.subspan(first, count), host);
    }
  }

  void readSomeWeights(std::span<const Origin> voxels, int reach, std::span<std::uint16_t> weights,
                       FollowingMap& host) {
    const DeviceList<Origin> list = asked_.send(voxels, memory_, stream());
    weights_.growWithRoom(memory_, voxels.size(), roomFor(voxels.size()), 0);
    launchReadWeights(cacheView(), list.data, list.count, reach, weights_.data(), stream());
    const std::size_t bytes = voxels.size() * sizeof(std::uint32_t);
    weights_on_host_.reserve(bytes);
    ACCESSVDB_CUDA(cudaMemcpyAsync(weights_on_host_.data(), weights_.data(), bytes, cudaMemcpyDeviceToHost, stream()));
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    const auto* const found = reinterpret_cast<const std::uint32_t*>(weights_on_host_.data());
    std::vector<PartOnHost> parts;
    for (std::size_t n = 0; n < weights.size(); ++n) {
      weights[n] = static_cast<std::uint16_t>(found[n] & kWeightMask);
      for (std::uint32_t left = found[n] >> kPartsShift; left != 0; left &= left - 1) {
        const WindowPart window = windowPart(voxels[n].data(), reach, std::countr_zero(left));
        parts.push_back({{window.first[0] & ~7, window.first[1] & ~7, window.first[2] & ~7}, window, n});
      }
    }
    if (!parts.empty()) addPartsOnHost(parts, voxels, weights, host);
  }

  FlipsOnDevice flips() const override {
    return {flip_leaves_.data(), flip_count_, flip_voxels_.data(), flip_voxel_count_};
  }

  void takeFlips(std::vector<LeafFlips>& leaves, std::vector<std::uint16_t>& voxels) override {
    const CurrentDevice current(context_->device());
    const std::size_t leaves_before = leaves.size(), voxels_before = voxels.size();
    leaves.resize(leaves_before + flip_count_);
    voxels.resize(voxels_before + flip_voxel_count_);
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    memory_.download(leaves.data() + leaves_before, flip_leaves_.data(), flip_count_ * sizeof(LeafFlips));
    memory_.download(voxels.data() + voxels_before, flip_voxels_.data(), flip_voxel_count_ * sizeof(std::uint16_t));
    for (std::size_t n = leaves_before; n < leaves.size(); ++n) {
      leaves[n].first_voxel += static_cast<std::uint32_t>(voxels_before);
    }
    clearFlips();
  }

  void clearFlips() override { flip_count_ = flip_voxel_count_ = 0; }

  std::uint64_t bytes() const override {
    return memory_.bytes() + value_slots_.bytes() + vote_slots_.bytes() + values_.bytes() + cleared_.bytes() +
           owner_.bytes() + stamp_.bytes() + votes_.bytes();
  }

  Slots readSlots() override {
    const CurrentDevice current(context_->device());
    Slots slots;
    const auto read = [this](const RangeArray<std::uint32_t>& from, std::size_t count, std::vector<std::uint32_t>& to) {
      to.resize(count);
      if (count > 0) memory_.download(to.data(), from.data(), count * sizeof(std::uint32_t));
    };
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    read(values_, value_slots_.count() * kValues, slots.values);
    read(cleared_, value_slots_.count() * kCleared, slots.cleared);
    read(votes_, vote_slots_.count() * kVotes, slots.votes);
    return slots;
  }

  /// Whether kernels do anything: of what a device says after a scan, nothing else would tell.
  [[nodiscard]] bool answers() {
    counters_.clear(stream());
    launchAnswer(counters_.data(), stream());
    return counters_.read(stream()).pairs == 1;
  }

  float lastMilliseconds() override {
    float milliseconds = 0;
    ACCESSVDB_CUDA(cudaEventElapsedTime(&milliseconds, begun_.get(), ended_.get()));
    return milliseconds;
  }

 private:
  /// Of the voxels around one.
  struct PartOnHost {
    Origin leaf;
    WindowPart window;
    std::size_t voxel;  ///< its number
  };

  static void addPartsOnHost(std::vector<PartOnHost>& parts, std::span<const Origin> voxels,
                             std::span<std::uint16_t> weights, FollowingMap& host) {
    std::ranges::sort(parts, {}, &PartOnHost::leaf);
    std::vector<LeafRecord> records;
    std::vector<std::size_t> unobserved;
    for (std::size_t first = 0, end = 0; first < parts.size(); first = end) {
      records.clear();
      for (end = first; end < parts.size(); ++end) {
        if (end > first && parts[end].leaf == parts[end - 1].leaf) continue;
        if (records.size() == kRecordsAtATime) break;
        records.emplace_back().origin_ijk = parts[end].leaf;
      }
      host.read(records);
      auto record = records.begin();
      for (std::size_t p = first; p < end; ++p) {
        const auto& [leaf, window, n] = parts[p];
        if (record->origin_ijk != leaf) ++record;
        const auto weightAt = [&, of = record](std::int32_t x, std::int32_t y, std::int32_t z) {
          return static_cast<std::uint16_t>(weightOf(of->values[(x & 7) << 6 | (y & 7) << 3 | (z & 7)]));
        };
        const Origin& own = voxels[n];
        if (window.holds(own.data()) && weightAt(own[0], own[1], own[2]) == 0) unobserved.push_back(n);
        for (std::int32_t x = window.first[0]; x <= window.last[0]; ++x)
          for (std::int32_t y = window.first[1]; y <= window.last[1]; ++y)
            for (std::int32_t z = window.first[2]; z <= window.last[2]; ++z)
              weights[n] = std::max(weights[n], weightAt(x, y, z));
      }
    }
    for (const std::size_t n : unobserved) weights[n] = 0;
  }

  /// The mirror's own: what it writes and what this writes are in order.
  [[nodiscard]] cudaStream_t stream() const { return context_->priorityStream(); }

  [[nodiscard]] ReachView viewOf(std::span<const ReturnRay> rays, std::uint32_t balls) {
    ReachView scan = {};
    scan.grid = grid_;
    scan.key_space = leafKeysFor(setting_.region, rays, balls);
    const DeviceList<ReturnRay> list = rays_.send(rays, memory_, stream());
    scan.rays = const_cast<ReturnRay*>(list.data);  // what they reach is noted in them
    scan.ray_count = list.count;
    scan.balls = balls;
    scan.region = setting_.region;
    scan.news = setting_.news;
    scan.votes = setting_.votes;
    scan.values = values_.data();
    scan.cleared = cleared_.data();
    first_pair_.growWithRoom(memory_, rays.size() + 1, roomFor(rays.size() + 1), 0);
    scan.first_pair = first_pair_.data();
    scan.counters = counters_.data();
    return scan;
  }

  /// As many leaves as pairs at most. @throws ResourceLimit
  void growPairs(std::uint32_t pairs, ReachView& scan) {
    const auto grow = [&](auto& array, std::size_t size) {
      array.growWithRoom(memory_, size, roomFor(size), 0);
      return array.data();
    };
    scan.keys = grow(keys_, pairs);
    scan.sorted_keys = grow(sorted_keys_, pairs);
    scan.entries = grow(entries_, pairs);
    scan.sorted_entries = grow(sorted_entries_, pairs);
    scan.leaf_of_pair = grow(leaf_of_pair_, pairs);
    scan.leaf_keys = grow(leaf_keys_, pairs);
    scan.leaves = grow(leaves_, pairs);
    scan.parts = grow(parts_, pairs);
    scan.needs = grow(needs_, pairs + std::size_t{1});
    scan.missed = grow(missed_, pairs);
    scan.classes = grow(classes_, pairs);
    scan.sorted_classes = grow(sorted_classes_, pairs);
    scan.order = grow(order_, pairs);
    scan.sorted_order = grow(sorted_order_, pairs);
  }

  /// @param most  what the scan may add or fill  @throws ResourceLimit
  void makeRoom(const ReachView& scan, const FusionCounters& most, const GridSpace& space, const Reserve& reserve,
                FollowingMap& host) {
    const std::uint64_t uppers = std::uint64_t{space.uppers} + most.missing_uppers;
    if (uppers > space.root_capacity) {
      throw ResourceLimit("map.root_tiles", "", "The map spreads over more regions than the mirror can number",
                          "Remove scans that are far from the rest, check the poses, or use larger voxels");
    }
    const auto grow = [&](auto& array, std::size_t size) { array.growWithRoom(memory_, size, roomFor(size), 0); };
    grow(outcomes_, most.leaves);
    grow(flips_, most.leaves);
    grow(found_, most.leaves + std::size_t{1});
    grow(new_leaves_, most.missing_leaves);
    grow(firsts_, most.missing_leaves + std::size_t{1});
    grow(new_lowers_, most.missing_lowers);
    grow(new_uppers_, most.missing_uppers);
    const std::size_t added = std::size_t{most.missing_leaves} + most.missing_lowers + most.missing_uppers;
    grow(origins_, added);
    origins_on_host_.reserve(added * sizeof(Origin));
    const std::size_t flipped = std::size_t{flip_count_} + most.leaves;
    flip_leaves_.growWithRoom(memory_, flipped, roomFor(flipped), flip_count_);
    const std::uint32_t votes = vote_slots_.counts().countWith(most.vote_needs);
    requireNumbers(votes);
    vote_slots_.growFree(roundedSlots(votes));
    votes_.grow(roundedSlots(votes) * kVotes);
    makeValueSlots(scan, most, most.value_needs, host);
    reserve(growthBytes(space, {most.missing_uppers, most.missing_lowers, most.missing_leaves}));
  }

  [[nodiscard]] static std::size_t roundedSlots(std::uint32_t slots) {
    return (std::size_t{slots} / kSlotsAtATime + 1) * kSlotsAtATime;
  }
  static void requireNumbers(std::uint64_t slots) {
    if (slots > kMostSlots - kSlotsAtATime) {
      throw ResourceLimit("memory.device", "cuda", "the map has more leaves than the GPU can number",
                          "Use larger voxels");
    }
  }

  /// Room for the values of more leaves, within the bound if what the scan reaches fits. @throws ResourceLimit
  void makeValueSlots(const ReachView& scan, const FusionCounters& most, std::uint32_t more, FollowingMap& host) {
    const std::uint64_t limit = setting_.cache_bytes / kSlotBytes;
    const std::uint64_t to_free = value_slots_.counts().toFree(more, limit);
    if (setting_.cache_bytes > 0 && to_free > 0) {
      launchKeepReached(scan, cacheView(), most.leaves, scans_ + 1, stream());
      evict(to_free, static_cast<std::uint32_t>(limit / 8), host);
    }
    const std::uint32_t slots = value_slots_.counts().countWith(more);
    requireNumbers(slots);
    const std::size_t rounded = roundedSlots(slots);
    value_slots_.growFree(static_cast<std::uint32_t>(rounded));
    values_.grow(rounded * kValues);
    cleared_.grow(rounded * kCleared);
    owner_.growFilled(rounded, 0xff, stream());
    stamp_.grow(rounded);
  }

  /// Frees at least `least` slots, and `more` if there are, those that were reached longest ago first; fewer only if
  /// the scan reaches all others. Of leaves that the host's map is behind with, this is the only copy.
  void evict(std::uint64_t least, std::uint32_t more, FollowingMap& host) {
    ages_.grow(memory_, CacheView::kAges + 1, 0);
    std::vector<std::uint32_t> by_age(CacheView::kAges);
    fillBytes(ages_.data(), 0, ages_.bytes(), stream());
    launchCountAges(cacheView(), scans_ + 1, ages_.data(), stream());
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    memory_.download(by_age.data(), ages_.data(), by_age.size() * sizeof(std::uint32_t));
    std::uint64_t freed = 0;
    std::uint32_t youngest = CacheView::kAges;  // to leave
    const auto take = [&](std::uint64_t until, std::uint64_t host_scans) {
      const std::uint64_t first = scans_ + 1 - host_scans;  // the age of what the host has
      while (freed < until && youngest > first) freed += by_age[--youngest];
    };
    take(least + more, host.scans());
    if (freed < least && host.scans() < scans_) {
      host.wait();
      take(least, scans_);
    }
    if (freed == 0) return;
    const std::uint32_t latest = scans_ + 1 - std::min(youngest, scans_ + 1);
    launchEvict(cacheView(), latest, value_slots_.view(), ages_.data() + CacheView::kAges, stream());
    value_slots_.giveBack(static_cast<std::uint32_t>(freed));
  }

  /// Brings back values from the host's map. @throws what it throws, ResourceLimit
  void takeMissed(const ReachView& scan, const FusionCounters& most, FollowingMap& host) {
    makeValueSlots(scan, most, most.missed, host);
    missed_origins_.growWithRoom(memory_, most.missed, roomFor(most.missed), 0);
    launchListMissed(scan, most.missed, missed_origins_.data(), stream());
    std::vector<Origin> origins(most.missed);
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    memory_.download(origins.data(), missed_origins_.data(), origins.size() * sizeof(Origin));
    for (std::size_t first = 0; first < origins.size(); first += kRecordsAtATime) {
      const std::size_t count = std::min(origins.size() - first, kRecordsAtATime);
      records_on_host_.resize(count);
      for (std::size_t n = 0; n < count; ++n) records_on_host_[n].origin_ijk = origins[first + n];
      host.read(records_on_host_);
      const DeviceList<LeafRecord> records =
          records_.send(std::span<const LeafRecord>(records_on_host_), memory_, stream());
      launchTakeRecords(scan, cacheView(), value_slots_.view(), 0, records, scan.missed + first, scans_ + 1, stream());
      value_slots_.take(static_cast<std::uint32_t>(count));
    }
  }

  /// Appends what flipped. The map has the scan already.
  void listFlips(const FusionView& fused, const FusionCounters& done) {
    const std::size_t voxels = std::size_t{flip_voxel_count_} + done.flipped_collisions;
    try {
      flip_voxels_.growWithRoom(memory_, voxels, roomFor(voxels), flip_voxel_count_);
    } catch (const ResourceLimit& error) {
      throw DeviceError("device.failed", "cuda", error.problem(), error.advice());
    }
    launchListFlips(fused, found_.data(), flip_leaves_.data() + flip_count_, flip_voxels_.data(), flip_voxel_count_,
                    stream());
    flip_count_ += done.changed_leaves;
    flip_voxel_count_ = static_cast<std::uint32_t>(voxels);
  }

  [[nodiscard]] CacheView cacheView() const {
    return {grid_, values_.data(), cleared_.data(), owner_.data(), stamp_.data(), value_slots_.count()};
  }

  [[nodiscard]] FusionView fusionOf(const ReachView& scan, const FusionCounters& most) const {
    FusionView view = {};
    view.rays = scan.rays;
    view.entries = scan.sorted_entries;
    view.leaves = scan.leaves;
    view.order = scan.sorted_order;
    view.count = most.leaves;
    view.heavy = most.heavy;
    view.full_cube = setting_.region.full_cube;
    view.thin_band = setting_.region.thinBand();
    view.constants = setting_.constants;
    view.grid = grid_;
    view.values = values_.data();
    view.cleared = cleared_.data();
    view.votes = votes_.data();
    view.outcomes = outcomes_.data();
    view.flips = flips_.data();
    return view;
  }

  [[nodiscard]] GrowthView growthOf(const GridSpace& space) const {
    GrowthView growth = {};
    growth.space = space;
    growth.found = found_.data();
    growth.new_leaves = new_leaves_.data();
    growth.firsts = firsts_.data();
    growth.new_lowers = new_lowers_.data();
    growth.new_uppers = new_uppers_.data();
    growth.origins = origins_.data();
    return growth;
  }

  [[nodiscard]] FusedScan outcomeOf(const FusionCounters& done) {
    FusedScan outcome;
    outcome.counts.distance_updates = done.distance_updates;
    outcome.counts.cleared_updates = done.cleared_updates;
    outcome.counts.newly_observed = done.newly_observed;
    outcome.counts.flipped_voxels = done.flipped_voxels;
    outcome.touched_leaves = done.touched_leaves;
    outcome.changed_leaves = done.changed_leaves;
    outcome.flips_hash = done.flips_hash;
    const std::size_t count = std::size_t{done.new_uppers} + done.new_lowers + done.new_leaves;
    if (count == 0) return outcome;
    ACCESSVDB_CUDA(cudaMemcpyAsync(origins_on_host_.data(), origins_.data(), count * sizeof(Origin),
                                   cudaMemcpyDeviceToHost, stream()));
    ACCESSVDB_CUDA(cudaStreamSynchronize(stream()));
    const auto* const all = reinterpret_cast<const Origin*>(origins_on_host_.data());
    outcome.growth.uppers = {all, done.new_uppers};
    outcome.growth.lowers = {all + done.new_uppers, done.new_lowers};
    outcome.growth.leaves = {all + done.new_uppers + done.new_lowers, done.new_leaves};
    return outcome;
  }

  std::shared_ptr<DeviceContext> context_;
  CountedMemory memory_;
  FusionSetting setting_;
  std::byte* grid_;
  CubScratch scratch_{memory_, {}};
  CountersOnDevice<FusionCounters> counters_;
  PinnedBuffer origins_on_host_;
  OwnedEvent begun_{cudaEventDefault}, ended_{cudaEventDefault};
  std::uint32_t scans_ = 0;

  // The map. Address ranges do not move as they grow.
  SlotList value_slots_, vote_slots_;
  RangeArray<std::uint32_t> values_, cleared_, owner_, stamp_, votes_;
  DeviceArray<std::uint32_t> ages_;

  // What flipped since clearFlips().
  DeviceArray<LeafFlips> flip_leaves_;
  DeviceArray<std::uint16_t> flip_voxels_;
  std::uint32_t flip_count_ = 0, flip_voxel_count_ = 0;

  // What came back from the host, and what is asked about weights.
  std::vector<LeafRecord> records_on_host_;
  Staging<LeafRecord> records_;
  DeviceArray<Origin> missed_origins_;
  Staging<Origin> asked_;
  DeviceArray<std::uint32_t> weights_;
  PinnedBuffer weights_on_host_;

  // The scan.
  Staging<ReturnRay> rays_;
  DeviceArray<std::uint32_t> first_pair_;
  DeviceArray<std::uint64_t> keys_, sorted_keys_, leaf_keys_, needs_;
  DeviceArray<LeafEntry> entries_, sorted_entries_;
  DeviceArray<std::uint32_t> leaf_of_pair_, parts_, missed_, order_, sorted_order_;
  DeviceArray<std::uint8_t> classes_, sorted_classes_;
  DeviceArray<FusedLeaf> leaves_;
  DeviceArray<FusedOutcome> outcomes_;
  DeviceArray<FusedFlips> flips_;
  DeviceArray<FoundLeaf> found_;
  DeviceArray<std::uint32_t> new_leaves_, firsts_;
  DeviceArray<std::uint64_t> new_lowers_, new_uppers_;
  DeviceArray<Origin> origins_;  ///< of new upper nodes, lower nodes and leaves
};

}  // namespace

std::unique_ptr<DeviceScanFuser> makeScanFuser(std::shared_ptr<DeviceContext> context, DeviceMemory& memory,
                                               const FusionSetting& setting, const OccupancyGrid* grid) {
  const CurrentDevice current(context->device());
  auto fuser = std::make_unique<Implementation>(std::move(context), memory, setting, grid);
  if (!fuser->answers()) return nullptr;
  return fuser;
}

}  // namespace accessvdb::kernels
