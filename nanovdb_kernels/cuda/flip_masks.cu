// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the flips of a frame mean for the points of a group of blocks: which directions may have become better or
/// worse, and how far what is known of their collisions has aged.
///
/// Flips lie in tiles of 8 x 8 x 16 leaves, found through a hash table; a group's warp looks the tiles around it up
/// once.
#include "cuda/cuda_check.h"
#include "cuda/known_collisions.cuh"
#include "cuda/update_kernels.h"
#include "cuda/warp.cuh"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256, kWarps = kThreads / kWarp;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

__device__ std::uint64_t tileKey(std::int32_t x, std::int32_t y, std::int32_t part) {
  return placeKey(x >> FlipsView::kTileLog2, y >> FlipsView::kTileLog2, part);
}
/// Place of a column of leaves in its tile.
__device__ std::uint32_t placeInTile(std::int32_t x, std::int32_t y) {
  constexpr std::int32_t kSide = (1 << FlipsView::kTileLog2) - 1;
  return static_cast<std::uint32_t>((x & kSide) << FlipsView::kTileLog2 | (y & kSide));
}

__global__ void findTiles(UpdateView view, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const LeafFlips& flip = view.flips.list[n];
  bool is_new = false;
  const std::uint32_t slot = view.flips.hash.insert(tileKey(flip.leaf[0], flip.leaf[1], flip.leaf[2] >> 4), is_new);
  if (is_new) view.flips.tile_at[slot] = atomicAdd(&view.counters->flip_tiles, 1u);
}

__global__ void addFlips(UpdateView view, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const LeafFlips& flip = view.flips.list[n];
  const std::uint32_t slot = view.flips.hash.find(tileKey(flip.leaf[0], flip.leaf[1], flip.leaf[2] >> 4));
  const std::size_t column =
      std::size_t{view.flips.tile_at[slot]} * FlipsView::kColumns + placeInTile(flip.leaf[0], flip.leaf[1]);
  std::uint64_t bits = 0;
  for (int kind = 0; kind < 4; ++kind) {
    if ((flip.kinds >> kind & 1u) != 0) bits |= std::uint64_t{1} << (16 * kind + (flip.leaf[2] & 15));
  }
  atomicOr(reinterpret_cast<unsigned long long*>(view.flips.kinds + column), static_cast<unsigned long long>(bits));
  if (flip.freed != 0) view.flips.next[n] = atomicExch(view.flips.head + column, n);
}

/// The tiles around a group, in shared memory; where they are too many, the others are looked up each time.
class TilesAround {
 public:
  /// 32 KiB of a block's shared memory; with the lists of FreedLeaves still what it gets without asking.
  static constexpr int kMost = 1024;

  /// Room that they need around any group; at most kMost.
  static int roomFor(const FootprintView& footprint) {
    std::int64_t tiles = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const int edge = axis == 2 ? 16 : 1 << FlipsView::kTileLog2;
      tiles *= (std::int64_t{footprint.high[axis]} - footprint.low[axis] + edge - 1) / edge + 1;
    }
    return tiles < kMost ? static_cast<int>(tiles) : kMost;
  }

  /// A warp; `any` tells whether there is one. @param leaf  the first one of the group  @param tiles  [room]
  __device__ TilesAround(const UpdateView& view, const std::int32_t* leaf, std::uint32_t* tiles, int room, int lane)
      : flips_(view.flips), tiles_(tiles), room_(room) {
    int count = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const int log2 = axis == 2 ? 4 : FlipsView::kTileLog2;
      low_[axis] = (leaf[axis] + view.footprint.low[axis]) >> log2;
      size_[axis] = ((leaf[axis] + view.footprint.high[axis]) >> log2) - low_[axis] + 1;
      count *= size_[axis];
    }
    any = false;
    for (int n = lane; n < count; n += static_cast<int>(kWarp)) {
      const int part = n % size_[2], xy = n / size_[2];
      const std::uint32_t tile = lookUp(placeKey(low_[0] + xy / size_[1], low_[1] + xy % size_[1], low_[2] + part));
      if (n < room) tiles[n] = tile;
      any = any || tile != kNoIndex;
    }
    any = __any_sync(kAllLanes, any);
    __syncwarp();
  }

  /// 16 leaves above each other: their place in the flips' columns, or kNoIndex.
  [[nodiscard]] __device__ std::uint32_t column(std::int32_t x, std::int32_t y, std::int32_t part) const {
    const int i = (x >> FlipsView::kTileLog2) - low_[0], j = (y >> FlipsView::kTileLog2) - low_[1], k = part - low_[2];
    const int n = (i * size_[1] + j) * size_[2] + k;
    const std::uint32_t tile = n < room_ ? tiles_[n] : lookUp(tileKey(x, y, part));
    return tile == kNoIndex ? kNoIndex : tile * FlipsView::kColumns + placeInTile(x, y);
  }

  bool any;

 private:
  [[nodiscard]] __device__ std::uint32_t lookUp(std::uint64_t key) const {
    const std::uint32_t slot = flips_.hash.find(key);
    return slot == kNoIndex ? kNoIndex : flips_.tile_at[slot];
  }

  const FlipsView& flips_;
  std::uint32_t* tiles_;
  int room_;
  std::int32_t low_[3], size_[3];
};

/// Leaves in which voxels ceased to collide, gathered by a warp until they are enough for all lanes to count them.
class FreedLeaves {
 public:
  static constexpr int kMost = 128;

  /// @param list  [kMost] shared by the warp  @param steps  see countFreed; null: nothing is counted
  __device__ FreedLeaves(const UpdateView& view, const std::int32_t* leaf, std::uint32_t* list, std::uint32_t* steps,
                         int lane)
      : view_(view), leaf_(leaf), list_(list), steps_(steps), lane_(lane) {}

  /// The leaves of a column of flips, one a lane; kNoIndex: none. All lanes.
  __device__ void add(std::uint32_t column, std::int32_t z_low, std::int32_t z_high) {
    if (steps_ == nullptr) return;
    std::uint32_t n = column != kNoIndex ? view_.flips.head[column] : kNoIndex;
    while (__any_sync(kAllLanes, n != kNoIndex)) {
      const std::int32_t z = n != kNoIndex ? view_.flips.list[n].leaf[2] : 0;
      const bool wanted = n != kNoIndex && z >= z_low && z <= z_high;
      const unsigned all = __ballot_sync(kAllLanes, wanted);
      if (wanted) list_[count_ + __popc(all & ((1u << lane_) - 1u))] = n;
      count_ += __popc(all);
      if (count_ > kMost - static_cast<int>(kWarp)) count();
      if (n != kNoIndex) n = view_.flips.next[n];
    }
  }
  /// Counts what was gathered. All lanes.
  __device__ void count() {
    __syncwarp();
    all_ += static_cast<std::uint32_t>(count_);
    for (int i = lane_ >> 3; i < count_ && !tooMany(); i += static_cast<int>(kWarp) / 8) {
      countFreed(view_, leaf_, view_.flips.list[list_[i]], lane_ & 7, steps_);
    }
    __syncwarp();
    count_ = 0;
  }
  /// Some were not counted.
  [[nodiscard]] __device__ bool tooMany() const { return all_ > kMostCountedLeaves; }

 private:
  const UpdateView& view_;
  const std::int32_t* leaf_;
  std::uint32_t* list_;
  std::uint32_t* steps_;
  std::uint32_t all_ = 0;
  int lane_, count_ = 0;
};

/// The masks of a group, spread over a warp to save registers: lane n has the n-th 32 bits of a GroupMasks.
class MasksOfWarp {
 public:
  enum Mask : int { kBetterTool, kBetterArm, kWorseTool, kWorseArm };  ///< in the order of GroupMasks

  explicit __device__ MasksOfWarp(int lane) : lane_(lane) {}

  /// Each lane adds directions to one mask, to two, or to none. All lanes.
  __device__ void add(Mask better, bool is_better, Mask worse, bool is_worse, const DirectionMask& directions) {
    if (!__any_sync(kAllLanes, is_better || is_worse)) return;
#pragma unroll
    for (int n = 0; n < kDirectionWords32; ++n) {
      std::uint32_t some = 0;
      if (is_better || is_worse) some = static_cast<std::uint32_t>(directions.word[n / 2] >> (32 * (n & 1)));
      const std::uint32_t all_better = __reduce_or_sync(kAllLanes, is_better ? some : 0u);
      const std::uint32_t all_worse = __reduce_or_sync(kAllLanes, is_worse ? some : 0u);
      if (lane_ == better * kDirectionWords32 + n) bits_ |= all_better;
      if (lane_ == worse * kDirectionWords32 + n) bits_ |= all_worse;
    }
  }
  /// @return word n of a mask. All lanes, each with its own n
  [[nodiscard]] __device__ std::uint32_t word(Mask mask, int n) const {
    return __shfl_sync(kAllLanes, bits_, mask * kDirectionWords32 + n);
  }
  /// Is there a direction in the first `masks` of them? All lanes.
  [[nodiscard]] __device__ bool any(int masks) const {
    return __any_sync(kAllLanes, bits_ != 0 && lane_ < masks * kDirectionWords32) != 0;
  }
  /// All lanes.
  __device__ void store(GroupMasks& masks) const {
    static_assert(sizeof(GroupMasks) == kWarp * sizeof(std::uint32_t));
    reinterpret_cast<std::uint32_t*>(&masks)[lane_] = bits_;
  }

 private:
  int lane_;
  std::uint32_t bits_ = 0;
};

/// Directions of a footprint with flips in their leaves, a column a lane. All lanes.
__device__ void scanFootprint(const UpdateView& view, const TilesAround& tiles, const std::int32_t* leaf,
                              const FootprintColumn* columns, std::uint32_t count, std::uint32_t better_kind,
                              std::uint32_t worse_kind, MasksOfWarp::Mask better, MasksOfWarp::Mask worse,
                              MasksOfWarp& masks, FreedLeaves& freed, int lane) {
  for (std::uint32_t first = 0; first < count; first += kWarp) {
    const std::uint32_t n = first + static_cast<std::uint32_t>(lane);
    const FootprintColumn& c = columns[n < count ? n : 0];
    const std::int32_t x = leaf[0] + c.dx, y = leaf[1] + c.dy, z_low = leaf[2] + c.z_low, z_high = leaf[2] + c.z_high;
    const int parts = n < count ? (z_high >> 4) - (z_low >> 4) + 1 : 0;
    const int most = __reduce_max_sync(kAllLanes, parts);
    std::uint32_t kinds = 0;
    for (int k = 0; k < most; ++k) {
      const std::int32_t part = (z_low >> 4) + k;
      const std::uint32_t column = k < parts ? tiles.column(x, y, part) : kNoIndex;
      std::uint32_t of_part = 0;
      if (column != kNoIndex) {
        const std::int32_t from = z_low - part * 16, to = z_high - part * 16;
        const std::uint32_t wanted = (0xffffu << (from > 0 ? from : 0)) & (0xffffu >> (to < 15 ? 15 - to : 0));
        const std::uint64_t bits = view.flips.kinds[column];
        for (int kind = 0; kind < 4; ++kind) {
          if ((static_cast<std::uint32_t>(bits >> (16 * kind)) & wanted) != 0) of_part |= 1u << kind;
        }
      }
      kinds |= of_part;
      freed.add((of_part & better_kind) != 0 ? column : kNoIndex, z_low, z_high);
    }
    masks.add(better, (kinds & better_kind) != 0, worse, (kinds & worse_kind) != 0, c.directions);
  }
}

/// A warp a group. @param room  for the tiles around a group
__global__ void groupMasks(UpdateView view, int room) {
  extern __shared__ std::uint32_t all_tiles[];  // [kWarps][room]
  __shared__ std::uint32_t all_steps[kWarps][32 * kDirectionWords32], all_freed[kWarps][FreedLeaves::kMost];
  const std::uint32_t group = (blockIdx.x * kThreads + threadIdx.x) / kWarp;
  if (group >= view.groups.groups) return;
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  const unsigned warp = threadIdx.x / kWarp;
  std::uint32_t* steps = view.known.levels != nullptr ? all_steps[warp] : nullptr;
  MasksOfWarp masks(lane);
  if (view.groups.with_points[group] != 0) {
    const std::int32_t* leaf = view.groups.leaf + 3 * static_cast<std::size_t>(group);
    const TilesAround tiles(view, leaf, all_tiles + warp * static_cast<unsigned>(room), room, lane);
    if (tiles.any) {
      if (steps != nullptr) {
        for (int n = lane; n < 32 * kDirectionWords32; n += static_cast<int>(kWarp)) steps[n] = 0;
        __syncwarp();
      }
      FreedLeaves freed(view, leaf, all_freed[warp], steps, lane), none(view, leaf, nullptr, nullptr, lane);
      scanFootprint(view, tiles, leaf, view.footprint.tool, view.footprint.tool_count, 2, 1, MasksOfWarp::kBetterTool,
                    MasksOfWarp::kWorseTool, masks, freed, lane);
      freed.count();
      scanFootprint(view, tiles, leaf, view.footprint.arm, view.footprint.arm_count, 4, 8, MasksOfWarp::kBetterArm,
                    MasksOfWarp::kWorseArm, masks, none, lane);
      if (steps != nullptr && masks.any(2)) {  // the better ones come first
        agePoints(view, group, steps, freed.tooMany(), masks.word(MasksOfWarp::kBetterArm, lane >> 2), lane);
      }
    }
  }
  masks.store(view.masks[group]);
  const bool affected = masks.any(4);
  if (lane == 0) view.affected[group] = affected ? 1 : 0;
}

}  // namespace

void launchFindTiles(const UpdateView& view, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  findTiles<<<blocksFor(count), kThreads, 0, stream>>>(view, count);
  checkLaunch("findTiles");
}

void launchAddFlips(const UpdateView& view, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  addFlips<<<blocksFor(count), kThreads, 0, stream>>>(view, count);
  checkLaunch("addFlips");
}

void launchGroupMasks(const UpdateView& view, cudaStream_t stream) {
  if (view.groups.groups == 0) return;
  const int room = TilesAround::roomFor(view.footprint);
  const std::size_t bytes = kWarps * static_cast<std::size_t>(room) * sizeof(std::uint32_t);
  groupMasks<<<blocksFor(std::uint64_t{view.groups.groups} * kWarp), kThreads, bytes, stream>>>(view, room);
  checkLaunch("groupMasks");
}

}  // namespace accessvdb::kernels
