// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the flips of a frame mean for the points of a block: which directions may have become better or worse, and how
/// far what is known of their collisions has aged.
///
/// Flips lie in tiles of 8 x 8 x 16 leaves, found through a hash table; a block's warp looks the tiles around it up
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

/// The tiles around a block, in shared memory; where they are too many, they are looked up each time.
class TilesAround {
 public:
  static constexpr int kMost = 384;

  /// A warp; `any` tells whether there is one. @param tiles  [kMost]
  __device__ TilesAround(const UpdateView& view, const std::int32_t* leaf, std::uint32_t* tiles, int lane)
      : flips_(view.flips), tiles_(tiles) {
    int count = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const int log2 = axis == 2 ? 4 : FlipsView::kTileLog2;
      low_[axis] = (leaf[axis] + view.footprint.low[axis]) >> log2;
      size_[axis] = ((leaf[axis] + view.footprint.high[axis]) >> log2) - low_[axis] + 1;
      count *= size_[axis];
    }
    cached_ = count <= kMost;
    any = !cached_;
    if (!cached_) return;
    for (int n = lane; n < count; n += static_cast<int>(kWarp)) {
      const int part = n % size_[2], xy = n / size_[2];
      tiles[n] = lookUp(placeKey(low_[0] + xy / size_[1], low_[1] + xy % size_[1], low_[2] + part));
      any = any || tiles[n] != kNoIndex;
    }
    any = __any_sync(kAllLanes, any);
    __syncwarp();
  }

  /// 16 leaves above each other: their place in the flips' columns, or kNoIndex.
  [[nodiscard]] __device__ std::uint32_t column(std::int32_t x, std::int32_t y, std::int32_t part) const {
    const int i = (x >> FlipsView::kTileLog2) - low_[0], j = (y >> FlipsView::kTileLog2) - low_[1], k = part - low_[2];
    const std::uint32_t tile = cached_ ? tiles_[(i * size_[1] + j) * size_[2] + k] : lookUp(tileKey(x, y, part));
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
  std::int32_t low_[3], size_[3];
  bool cached_;
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
    for (int i = lane_ >> 3; i < count_; i += static_cast<int>(kWarp) / 8) {
      countFreed(view_, leaf_, view_.flips.list[list_[i]], lane_ & 7, steps_);
    }
    __syncwarp();
    count_ = 0;
  }

 private:
  const UpdateView& view_;
  const std::int32_t* leaf_;
  std::uint32_t* list_;
  std::uint32_t* steps_;
  int lane_, count_ = 0;
};

__device__ void orInto(DirectionMask& into, const DirectionMask& from) {
  for (int w = 0; w < kMaxDirectionWords; ++w) into.word[w] |= from.word[w];
}

__device__ void orOfWarp(DirectionMask& mask) {
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    const auto low = __reduce_or_sync(kAllLanes, static_cast<unsigned>(mask.word[w]));
    const auto high = __reduce_or_sync(kAllLanes, static_cast<unsigned>(mask.word[w] >> 32));
    mask.word[w] = static_cast<std::uint64_t>(high) << 32 | low;
  }
}

__device__ bool anyOf(const DirectionMask& mask) {
  return (mask.word[0] | mask.word[1] | mask.word[2] | mask.word[3]) != 0;
}

/// Directions of a footprint with flips in their leaves, a column a lane. All lanes.
__device__ void scanFootprint(const UpdateView& view, const TilesAround& tiles, const std::int32_t* leaf,
                              const FootprintColumn* columns, std::uint32_t count, std::uint32_t better_kind,
                              std::uint32_t worse_kind, DirectionMask& better, DirectionMask& worse, FreedLeaves& freed,
                              int lane) {
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
    if ((kinds & better_kind) != 0) orInto(better, c.directions);
    if ((kinds & worse_kind) != 0) orInto(worse, c.directions);
  }
}

/// A warp a block.
__global__ void blockMasks(UpdateView view) {
  __shared__ std::uint32_t all_steps[kWarps][32 * kDirectionWords32], all_tiles[kWarps][TilesAround::kMost],
      all_freed[kWarps][FreedLeaves::kMost];
  const std::uint32_t block = (blockIdx.x * kThreads + threadIdx.x) / kWarp;
  if (block >= view.index.blocks) return;
  const int lane = static_cast<int>(threadIdx.x % kWarp);
  const unsigned warp = threadIdx.x / kWarp;
  std::uint32_t* steps = view.known.levels != nullptr ? all_steps[warp] : nullptr;
  BlockMasks masks = {};
  if (view.index.reach_m[block] >= 0) {
    const std::int32_t* leaf = view.index.leaf + 3 * static_cast<std::size_t>(block);
    const TilesAround tiles(view, leaf, all_tiles[warp], lane);
    if (tiles.any) {
      if (steps != nullptr) {
        for (int n = lane; n < 32 * kDirectionWords32; n += static_cast<int>(kWarp)) steps[n] = 0;
        __syncwarp();
      }
      FreedLeaves freed(view, leaf, all_freed[warp], steps, lane), none(view, leaf, nullptr, nullptr, lane);
      scanFootprint(view, tiles, leaf, view.footprint.tool, view.footprint.tool_count, 2, 1, masks.better_tool,
                    masks.worse_tool, freed, lane);
      freed.count();
      scanFootprint(view, tiles, leaf, view.footprint.arm, view.footprint.arm_count, 4, 8, masks.better_arm,
                    masks.worse_arm, none, lane);
      for (DirectionMask* mask : {&masks.better_tool, &masks.better_arm, &masks.worse_tool, &masks.worse_arm}) {
        orOfWarp(*mask);
      }
      if (steps != nullptr && (anyOf(masks.better_tool) || anyOf(masks.better_arm))) {
        agePoints(view, block, steps, masks.better_arm, lane);
      }
    }
  }
  if (lane != 0) return;
  view.masks[block] = masks;
  view.affected[block] =
      anyOf(masks.better_tool) || anyOf(masks.better_arm) || anyOf(masks.worse_tool) || anyOf(masks.worse_arm) ? 1 : 0;
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

void launchBlockMasks(const UpdateView& view, cudaStream_t stream) {
  if (view.index.blocks == 0) return;
  blockMasks<<<blocksFor(std::uint64_t{view.index.blocks} * kWarp), kThreads, 0, stream>>>(view);
  checkLaunch("blockMasks");
}

}  // namespace accessvdb::kernels
