// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the flips of a frame mean for the points of a group of blocks: which directions may have become better or
/// worse, and how far what is known about their collisions has aged.
///
/// Flips are stored in tiles of 8 x 8 x 16 leaves, found through a hash table. A group's warp looks up the tiles around
/// it, lists their columns that hold flips, of which there are few, and looks up in the footprints what they mean.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/flips_near.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/masks_of_warp.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kThreads = 256;
/// Blocks for groups that a multiprocessor should hold: this limits the registers. Shared memory may limit it to fewer.
constexpr unsigned kGroupBlocks = 28;

unsigned blocksFor(std::uint64_t threads) { return static_cast<unsigned>((threads + kThreads - 1) / kThreads); }

/// Index of a column of leaves in its tile.
__device__ std::uint32_t placeInTile(std::int32_t x, std::int32_t y) {
  constexpr std::int32_t kSide = (1 << FlipsView::kTileLog2) - 1;
  return static_cast<std::uint32_t>((x & kSide) << FlipsView::kTileLog2 | (y & kSide));
}

__global__ void findTiles(FlipsView flips, std::uint32_t count, std::uint32_t* num_tiles) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const LeafFlips& flip = flips.list[n];
  bool is_new = false;
  const std::uint32_t slot = flips.hash.insert(FlipsView::keyOf(flip.leaf), is_new);
  if (is_new) flips.tile_at[slot] = atomicAdd(num_tiles, 1u);
}

__global__ void addFlips(FlipsView flips, std::uint32_t count) {
  const std::uint32_t n = blockIdx.x * kThreads + threadIdx.x;
  if (n >= count) return;
  const LeafFlips& flip = flips.list[n];
  const std::uint32_t slot = flips.hash.find(FlipsView::keyOf(flip.leaf));
  const std::uint32_t tile = flips.tile_at[slot], place = placeInTile(flip.leaf[0], flip.leaf[1]);
  const std::size_t column = std::size_t{tile} * FlipsView::kColumns + place;
  atomicOr(reinterpret_cast<unsigned long long*>(flips.occupied + tile), 1ull << place);
  std::uint64_t bits = 0;
  for (int kind = 0; kind < 4; ++kind) {
    if ((flip.kinds >> kind & 1u) != 0) bits |= std::uint64_t{1} << (16 * kind + (flip.leaf[2] & 15));
  }
  atomicOr(reinterpret_cast<unsigned long long*>(flips.kinds + column), static_cast<unsigned long long>(bits));
  if (flip.freed != 0) flips.links[n] = {atomicExch(flips.head + column, n), flip.leaf[2]};
  if ((flip.freed_columns | flip.blocked_columns) != 0)
    flips.arm_links[n] = {atomicExch(flips.arm_head + column, n), flip.leaf[2]};
}

/// What a lane needs to read this update's flips.
struct FlipScope {
  const FlipContext& context;
  const FlipsView& flips;
  int lane;
};

/// Leaves in which voxels stopped colliding that a warp gathers at a time.
constexpr int kMostGathered = 128;

/// Leaves in which voxels stopped colliding, gathered by a warp until there are enough to keep all lanes counting.
/// @tparam kSets  as for countFreed
template <bool kSets>
class FreedLeaves {
 public:
  /// @param leaf  the group's first leaf  @param list  [kMostGathered] shared by the warp
  /// @param steps  see countFreed; null: nothing is counted
  __device__ FreedLeaves(const FlipScope& scope, const std::int32_t* leaf, std::uint32_t* list, std::uint32_t* steps)
      : scope_(scope), leaf_(leaf), list_(list), steps_(steps), lane_(scope.lane) {}

  /// Adds the leaves of one column of flips per lane; kNoIndex: none. All lanes call it.
  __device__ void add(std::uint32_t column, std::int32_t z_low, std::int32_t z_high) {
    if (steps_ == nullptr) return;
    const std::uint32_t head = column != kNoIndex ? scope_.flips.head[column] : kNoIndex;
    forEachInLayers(scope_.flips.links, head, z_low, z_high, [&](std::uint32_t n, bool wanted) {
      const unsigned all = __ballot_sync(kAllLanes, wanted);
      if (wanted) list_[count_ + __popc(all & ((1u << lane_) - 1u))] = n;
      count_ += __popc(all);
      if (count_ > kMostGathered - static_cast<int>(kWarp)) count();
    });
  }
  /// Counts what was gathered. All lanes call it.
  __device__ void count() {
    __syncwarp();
    all_ += static_cast<std::uint32_t>(count_);
    for (int i = lane_ >> 3; i < count_ && !tooMany(); i += static_cast<int>(kWarp) / 8) {
      countFreed<kSets>(scope_.context, leaf_, scope_.flips.list[list_[i]], lane_ & 7, steps_);
    }
    __syncwarp();
    count_ = 0;
  }
  /// Whether some were not counted.
  [[nodiscard]] __device__ bool tooMany() const { return all_ > kMostCountedLeaves; }

 private:
  const FlipScope& scope_;
  const std::int32_t* leaf_;
  std::uint32_t* list_;
  std::uint32_t* steps_;
  std::uint32_t all_ = 0;
  int lane_, count_ = 0;
};

/// Gathers the leaves in which voxels became free for the corridors of a group's points, or ceased to be, with a warp.
class ArmLeaves {
 public:
  /// @param leaves  shared by the warp; null: nothing is gathered  @param freed  or those that ceased to be free
  __device__ ArmLeaves(LeavesOfArm* leaves, bool freed, int lane) : leaves_(leaves), freed_(freed), lane_(lane) {}

  /// Adds one column per lane, or none: kNoIndex. All lanes call it.
  __device__ void add(std::uint32_t column) {
    if (leaves_ == nullptr) return;
    const unsigned all = __ballot_sync(kAllLanes, column != kNoIndex);
    const int at = count_ + __popc(all & ((1u << lane_) - 1u));
    if (column != kNoIndex && at < LeavesOfArm::kMostColumns) leaves_->columns[at] = column;
    count_ += __popc(all);
  }
  /// Lists the leaves in layers z_low .. z_high. All lanes call it.
  /// @return null if there may be more
  __device__ LeavesOfArm* list(const FlipsView& flips, std::int32_t z_low, std::int32_t z_high) const {
    if (leaves_ == nullptr || count_ > LeavesOfArm::kMostColumns) return nullptr;
    __syncwarp();
    int listed = 0;
    for (int first = 0; first < count_; first += static_cast<int>(kWarp)) {
      const std::uint32_t head = first + lane_ < count_ ? flips.arm_head[leaves_->columns[first + lane_]] : kNoIndex;
      forEachInLayers(flips.arm_links, head, z_low, z_high, [&](std::uint32_t n, bool wanted) {
        wanted = wanted && heightsOf(flips.list[n]) != 0;
        const unsigned all = __ballot_sync(kAllLanes, wanted);
        const int at = listed + __popc(all & ((1u << lane_) - 1u));
        if (wanted && at < LeavesOfArm::kMost) leaves_->index[at] = n;
        listed += __popc(all);
      });
    }
    if (listed > LeavesOfArm::kMost) return nullptr;
    __syncwarp();
    for (int first = 0; first < listed; first += static_cast<int>(kWarp)) {
      const std::uint32_t heights = first + lane_ < listed ? heightsOf(flips.list[leaves_->index[first + lane_]]) : 0;
      std::uint32_t mine = 0;
      for (int z = 0; z < 8; ++z) {
        const unsigned all = __ballot_sync(kAllLanes, (heights >> z & 1u) != 0);
        if (lane_ == z) mine = all;
      }
      if (lane_ < 8) leaves_->at_height[first / static_cast<int>(kWarp)][lane_] = mine;
    }
    if (lane_ == 0) leaves_->count = listed;
    __syncwarp();
    return leaves_;
  }

 private:
  [[nodiscard]] __device__ std::uint32_t heightsOf(const LeafFlips& flips) const {
    return freed_ ? flips.freed_heights : flips.blocked_heights;
  }

  LeavesOfArm* leaves_;
  bool freed_;
  int lane_, count_ = 0;
};

/// Finds out with one warp what flips mean for a group.
/// @tparam kByLeaf  whether the footprint has a set of directions for each leaf (FootprintView::heights)
template <bool kByLeaf>
class GroupScan {
 public:
  /// Where it puts what it finds.
  struct Found {
    MasksOfWarp& masks;
    FreedLeaves<kByLeaf>& freed;
    ArmLeaves &freed_arms, &blocked_arms;
  };
  /// @param leaf  the group's first leaf  @param list  [kMostListed] shared by the warp
  __device__ GroupScan(const FlipScope& scope, const std::int32_t* leaf, std::uint16_t* list, const Found& found)
      : scope_(scope),
        leaf_(leaf),
        list_(list),
        masks_(found.masks),
        freed_(found.freed),
        freed_arms_(found.freed_arms),
        blocked_arms_(found.blocked_arms),
        lane_(scope.lane) {}

  /// All lanes.
  __device__ void scanAll() {
    const FootprintView& footprint = scope_.context.footprint;
    const auto take = [&](const ColumnNear& near) {
      const FootprintPlace at = near.there ? footprint.at(near.dx, near.dy) : FootprintPlace{};
      const std::uint64_t bits = near.there ? scope_.flips.kinds[near.column] : 0;
      if constexpr (kByLeaf) {
        const FootprintPlace height = near.there ? footprint.heightAt(near.dx, near.dy) : FootprintPlace{};
        takeLeaves(at, height, near.dz, bits, near.column);
      } else {
        takeColumn(at, near.dz, bits, near.column);
      }
    };
    ColumnsNear(scope_.flips, leaf_, list_, lane_, take).scan(footprint.low, footprint.high);
  }

 private:
  /// One column of flips per lane, with one set of directions for all of its leaves. All lanes.
  __device__ void takeColumn(const FootprintPlace& at, std::int32_t dz, std::uint64_t bits, std::uint32_t column) {
    const FootprintColumn *const of_tool = scope_.context.footprint.tool, *const of_arm = scope_.context.footprint.arm;
    const std::uint32_t tool = kindsIn(of_tool, at.tool, dz, bits);
    take(of_tool, at.tool, tool, 2, 1, MasksOfWarp::kBetterTool, MasksOfWarp::kWorseTool);
    const bool is_freed = (tool & 2u) != 0;
    const std::int32_t z_low = is_freed ? of_tool[at.tool - 1].z_low : 0,
                       z_high = is_freed ? of_tool[at.tool - 1].z_high : 0;
    freed_.add(is_freed ? column : kNoIndex, leaf_[2] + z_low, leaf_[2] + z_high);
    const std::uint32_t arm = kindsIn(of_arm, at.arm, dz, bits);
    take(of_arm, at.arm, arm, 4, 8, MasksOfWarp::kBetterArm, MasksOfWarp::kWorseArm);
    freed_arms_.add((arm & 4u) != 0 ? column : kNoIndex);
    blocked_arms_.add((arm & 8u) != 0 ? column : kNoIndex);
  }

  /// One column of flips per lane, with a set of directions for each of its leaves. All lanes.
  /// @param lowest  of the footprint's columns at this offset: index + 1  @param height  how many there are
  __device__ void takeLeaves(const FootprintPlace& lowest, const FootprintPlace& height, std::int32_t dz,
                             std::uint64_t bits, std::uint32_t column) {
    const FootprintColumn *const tool = scope_.context.footprint.tool, *const arm = scope_.context.footprint.arm;
    const std::int32_t tool_low = lowest.tool != 0 ? tool[lowest.tool - 1].z_low : 0,
                       arm_low = lowest.arm != 0 ? arm[lowest.arm - 1].z_low : 0;
    const auto ofKind = [bits](int kind) { return static_cast<std::uint32_t>(bits >> (16 * kind)) & 0xffffu; };
    takeStack({tool, lowest.tool, height.tool, tool_low - dz}, ofKind(1), ofKind(0), MasksOfWarp::kBetterTool,
              MasksOfWarp::kWorseTool);
    takeStack({arm, lowest.arm, height.arm, arm_low - dz}, ofKind(2), ofKind(3), MasksOfWarp::kBetterArm,
              MasksOfWarp::kWorseArm);
    const bool is_freed = lowest.tool != 0 && ofKind(1) != 0;
    freed_.add(is_freed ? column : kNoIndex, leaf_[2] + tool_low,
               leaf_[2] + tool_low + static_cast<std::int32_t>(height.tool) - 1);
  }

  /// Footprint columns of one leaf each, above each other.
  struct Stack {
    const FootprintColumn* columns;
    std::uint32_t number, height;  ///< of the lowest: index + 1, or 0 for none; how many there are
    std::int32_t from;             ///< the lowest leaf, counted from the first of the 16 leaves of a column of flips
  };
  /// Each lane goes through its own leaves: lanes differ in which of the 16 have flips. All lanes.
  /// @param better, worse  leaves with a flip of that sign
  __device__ void takeStack(const Stack& stack, std::uint32_t better, std::uint32_t worse,
                            MasksOfWarp::Mask better_mask, MasksOfWarp::Mask worse_mask) {
    DirectionMask for_better = {}, for_worse = {};
    std::uint32_t left = stack.number != 0 ? (better | worse) & leavesFrom(stack.from, stack.height) : 0;
    const bool is_any = left != 0;
    for (; left != 0; left &= left - 1) {
      const int z = __ffs(static_cast<int>(left)) - 1;
      const DirectionMask& directions =
          stack.columns[stack.number - 1 + static_cast<std::uint32_t>(z - stack.from)].directions;
      const std::uint64_t is_better = 0 - std::uint64_t{better >> z & 1u},
                          is_worse = 0 - std::uint64_t{worse >> z & 1u};
#pragma unroll
      for (int w = 0; w < kMaxDirectionWords; ++w) {
        const std::uint64_t word = directions.word[w];
        for_better.word[w] |= word & is_better;
        for_worse.word[w] |= word & is_worse;
      }
    }
    masks_.add(better_mask, for_better, worse_mask, for_worse, is_any);
  }
  /// Those of 16 leaves above each other that lie in `count` leaves from `from` on.
  [[nodiscard]] __device__ static std::uint32_t leavesFrom(std::int32_t from, std::uint32_t count) {
    const std::int32_t end = from + static_cast<std::int32_t>(count);
    if (from > 15 || end <= 0) return 0;
    return (0xffffu << (from > 0 ? from : 0)) & (0xffffu >> (end < 16 ? 16 - end : 0));
  }

  /// Kinds of flips that a footprint column meets. @param number  index + 1, or 0 for none
  /// @param dz  of the lowest of the 16 leaves  @param bits  FlipsView::kinds
  [[nodiscard]] __device__ static std::uint32_t kindsIn(const FootprintColumn* columns, std::uint32_t number,
                                                        std::int32_t dz, std::uint64_t bits) {
    if (number == 0) return 0;
    const FootprintColumn& column = columns[number - 1];
    const std::uint32_t wanted =
        leavesFrom(column.z_low - dz, static_cast<std::uint32_t>(column.z_high - column.z_low + 1));
    if (wanted == 0) return 0;
    std::uint32_t kinds = 0;
    for (int kind = 0; kind < 4; ++kind) {
      if ((static_cast<std::uint32_t>(bits >> (16 * kind)) & wanted) != 0) kinds |= 1u << kind;
    }
    return kinds;
  }

  /// All lanes.
  __device__ void take(const FootprintColumn* columns, std::uint32_t number, std::uint32_t kinds,
                       std::uint32_t better_kind, std::uint32_t worse_kind, MasksOfWarp::Mask better,
                       MasksOfWarp::Mask worse) {
    masks_.add(better, (kinds & better_kind) != 0, worse, (kinds & worse_kind) != 0,
               columns[number > 0 ? number - 1 : 0].directions);
  }

  const FlipScope& scope_;
  const std::int32_t* leaf_;
  std::uint16_t* list_;
  MasksOfWarp& masks_;
  FreedLeaves<kByLeaf>& freed_;
  ArmLeaves &freed_arms_, &blocked_arms_;
  int lane_;
};

/// One block of one warp per group: some groups take long, others no time.
template <bool kByLeaf>
__global__ void __launch_bounds__(kWarp, kGroupBlocks)
    groupMasks(const __grid_constant__ FlipContext context, const __grid_constant__ FlipsView flips,
               const __grid_constant__ GroupMasksView out) {
  __shared__ std::uint32_t steps[32 * kDirectionWords32], gathered[kMostGathered];
  __shared__ std::uint16_t columns[kMostListed];
  __shared__ LeavesOfArm freed_of_arm, blocked_of_arm;
  const std::uint32_t group = blockIdx.x;
  const int lane = static_cast<int>(threadIdx.x);
  MasksOfWarp masks(lane);
  if (context.groups.with_points[group] != 0) {
    const std::int32_t* leaf = context.groups.leaf + 3 * static_cast<std::size_t>(group);
    const bool remembers = context.known.remembers();
    for (int n = lane; n < 32 * kDirectionWords32; n += static_cast<int>(kWarp)) steps[n] = 0;
    __syncwarp();
    const FlipScope scope = {context, flips, lane};
    FreedLeaves<kByLeaf> freed(scope, leaf, gathered, remembers ? steps : nullptr);
    const bool by_corridor = !kByLeaf && remembers && context.corridors.table != nullptr;
    ArmLeaves freed_arms(by_corridor ? &freed_of_arm : nullptr, true, lane),
        blocked_arms(by_corridor ? &blocked_of_arm : nullptr, false, lane);
    GroupScan<kByLeaf>(scope, leaf, columns, {masks, freed, freed_arms, blocked_arms}).scanAll();
    freed.count();
    const std::int32_t highest = leaf[2] + (1 << context.groups.log2) - 1;
    if (remembers && masks.any(2)) {  // the better masks come first
      const Ageing ageing = {steps, freed.tooMany(), masks.word(MasksOfWarp::kBetterArm, lane >> 2), flips.list,
                             freed_arms.list(flips, leaf[2], highest)};
      masks.limitBetter(agePoints(context, group, ageing, lane));
    }
    if (out.arm_bits != nullptr && masks.any(MasksOfWarp::kWorseArm)) {
      markBlocked(context, group, flips.list, blocked_arms.list(flips, leaf[2], highest), out.arm_bits, lane);
    }
  }
  masks.store(out.masks[group]);
  const bool affected = masks.any(4);
  if (lane == 0) out.affected[group] = affected ? 1 : 0;
}

}  // namespace

void launchFindTiles(const FlipsView& flips, std::uint32_t count, std::uint32_t* num_tiles, cudaStream_t stream) {
  if (count == 0) return;
  findTiles<<<blocksFor(count), kThreads, 0, stream>>>(flips, count, num_tiles);
  checkLaunch("findTiles");
}

void launchAddFlips(const FlipsView& flips, std::uint32_t count, cudaStream_t stream) {
  if (count == 0) return;
  addFlips<<<blocksFor(count), kThreads, 0, stream>>>(flips, count);
  checkLaunch("addFlips");
}

void launchGroupMasks(const FlipContext& context, const FlipsView& flips, const GroupMasksView& masks,
                      cudaStream_t stream) {
  const std::uint32_t groups = context.groups.groups;
  if (groups == 0) return;
  // Each has only what it needs: code that is not used would cost registers.
  if (context.footprint.heights != nullptr) {
    groupMasks<true><<<groups, kWarp, 0, stream>>>(context, flips, masks);
  } else {
    groupMasks<false><<<groups, kWarp, 0, stream>>>(context, flips, masks);
  }
  checkLaunch("groupMasks");
}

}  // namespace accessvdb::kernels
