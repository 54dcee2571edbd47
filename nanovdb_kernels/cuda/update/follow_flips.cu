// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Lets what is known about the collisions of points follow each voxel that began or ceased to collide. The directions
/// that cover a voxel at an offset from a point are one arc or two (ArcsView), so that a voxel changes the counts in
/// all of them by a few steps, which are summed up once per point.
///
/// A warp takes a block of points: it gathers the flipped voxels in reach of the block, and has each of its lanes take
/// them all for one point. The steps of a lane lie in its own bank of shared memory. Where so many voxels flipped that
/// testing is cheaper, as on new ground, it only lowers the bounds by what may have become free, cell by cell.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

/// Voxels that are taken at a time: no step of one byte may overflow.
constexpr int kMostVoxels = 124;
static_assert(kMostVoxels <= known_count::kMostTogether);
/// Voxels whose arcs are read together, to hide memory latency.
constexpr int kTogether = 4;
static_assert(kMostVoxels % kTogether == 0);

/// Where more voxels than this flipped in the leaves around a block for each point that a warp's lanes take together,
/// as on new ground, bounds are only lowered: testing those points again costs less than following.
constexpr std::uint32_t kMostPerPoint = 150;

/// A flipped voxel near a block, seen from where ArcsView begins for a point in the block's first voxel, in one word.
struct VoxelNear {
  static constexpr int kHeightBits = 9;

  [[nodiscard]] static __device__ std::uint32_t code(std::int32_t column, std::int32_t height) {
    return static_cast<std::uint32_t>(column) << kHeightBits | static_cast<std::uint32_t>(height);
  }
  [[nodiscard]] static __device__ std::uint32_t column(std::uint32_t code) { return code >> kHeightBits; }
  [[nodiscard]] static __device__ std::uint32_t height(std::uint32_t code) { return code & ((1u << kHeightBits) - 1); }
};

/// Those near a block, in memory that a warp shares: the ones that began to collide, and those that ceased to.
struct VoxelsNear {
  alignas(16) std::uint32_t worse[kMostVoxels + kTogether], better[kMostVoxels + kTogether];
  std::uint16_t points[kMostInBlock];  ///< places in the block's list of those of which any bound is known
};

/// The steps of a warp: one byte for each direction and lane (stepPlace).
extern __shared__ __align__(16) std::uint32_t all_steps[];

class BlockFollower {
 public:
  /// @param near  shared by the warp
  __device__ BlockFollower(const FollowContext& context, std::uint32_t block, VoxelsNear& near, int lane)
      : context_(context),
        near_(near),
        block_(block),
        lane_(lane),
        leaf_(context.points.index.leaf + 3 * std::size_t{block}),
        steps_(reinterpret_cast<std::int8_t*>(all_steps + lane)) {}

  /// All lanes.
  __device__ void followAll() {
    listKnown();
    if (points_ == 0) return;
    const ArcsView& arcs = context_.arcs;
    std::int32_t low[3], high[3];  // [leaves]
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = (leaf_[axis] * 8 + arcs.low[axis] + ArcsView::kMargin) >> 3;
      high[axis] = (leaf_[axis] * 8 + arcs.low[axis] + arcs.size[axis] - ArcsView::kMargin + 6) >> 3;
    }
    std::uint32_t voxels = 0;
    forEachTile(low, high, [&](const Tile& tile) { voxels += __reduce_add_sync(kAllLanes, tile.end - tile.begin); });
    if (voxels == 0) return;
    const auto points = static_cast<std::uint32_t>(points_);
    if (std::uint64_t{voxels} * ((points + kWarp - 1) / kWarp) > kMostPerPoint * points) return lowerAll();
    forEachTile(low, high, [&](const Tile& tile) { takeTiles(tile); });
    takeVoxels();
  }

 private:
  /// The voxels of some layers of a tile; one tile per lane.
  struct Tile {
    std::int32_t origin[3] = {0, 0, 0};  ///< [voxels] its first one, from where ArcsView begins
    std::uint32_t begin = 0, end = 0;    ///< of FlipsView::by_layer
  };

  /// Calls visit(tile) with a tile per lane. All lanes. @param low, high  [leaves] inclusive
  template <class Visit>
  __device__ void forEachTile(const std::int32_t (&low)[3], const std::int32_t (&high)[3], const Visit& visit) const {
    constexpr int kLog2[3] = {FlipsView::kTileLog2, FlipsView::kTileLog2, 4};
    std::int32_t first[3], size[3];
    for (int axis = 0; axis < 3; ++axis) {
      first[axis] = low[axis] >> kLog2[axis];
      size[axis] = (high[axis] >> kLog2[axis]) - first[axis] + 1;
    }
    const int count = size[0] * size[1] * size[2];
    for (int base = 0; base < count; base += static_cast<int>(kWarp)) {
      const int n = base + lane_;
      Tile tile;
      if (n < count) {
        const std::int32_t at[3] = {first[0] + n / size[2] / size[1], first[1] + n / size[2] % size[1],
                                    first[2] + n % size[2]};
        const std::uint32_t slot = context_.flips.hash.find(placeKey(at[0], at[1], at[2]));
        if (slot != kNoIndex) {
          for (int axis = 0; axis < 3; ++axis) {
            tile.origin[axis] = ((at[axis] << kLog2[axis]) - leaf_[axis]) * 8 - context_.arcs.low[axis];
          }
          const std::int32_t below = at[2] << 4, lowest = low[2] > below ? low[2] - below : 0,
                             highest = high[2] < below + 15 ? high[2] - below : 15;
          const std::uint32_t* layers = context_.flips.layer_begin + context_.flips.tile_at[slot] * FlipsView::kLayers;
          tile.begin = layers[lowest];
          tile.end = layers[highest + 1];
        }
      }
      visit(tile);
    }
  }

  /// Takes the voxels of one tile per lane. All lanes.
  __device__ void takeTiles(const Tile& mine) {
    const std::uint32_t end = sumUpTo(mine.end - mine.begin, lane_), all = __shfl_sync(kAllLanes, end, 31);
    for (std::uint32_t from = 0; from < all; from += kWarp) {
      const std::uint32_t at = from + static_cast<std::uint32_t>(lane_);
      int owner = 0;  // the first lane with at < end
      for (int step = 16; step > 0; step /= 2) {
        if (__shfl_sync(kAllLanes, end, owner + step - 1) <= at) owner += step;
      }
      const std::uint32_t place = __shfl_sync(kAllLanes, mine.end - end, owner) + at;
      std::int32_t near[3];
      for (int axis = 0; axis < 3; ++axis) near[axis] = __shfl_sync(kAllLanes, mine.origin[axis], owner);
      const std::uint32_t code = at < all ? context_.flips.by_layer[place] : 0;
      near[0] += static_cast<std::int32_t>(code >> 14);
      near[1] += static_cast<std::int32_t>(code >> 8 & 63u);
      near[2] += static_cast<std::int32_t>(code >> 1 & 127u);
      takeVoxel(near, (code & 1u) != 0, at < all && isNear(near));
    }
  }

  /// Whether any point of the block may reach a voxel.
  [[nodiscard]] __device__ bool isNear(const std::int32_t (&near)[3]) const {
    const ArcsView& arcs = context_.arcs;
    std::int32_t squared = 0;
    for (int axis = 0; axis < 3; ++axis) {
      // Points of the block are up to seven voxels on.
      if (near[axis] < ArcsView::kMargin || near[axis] >= arcs.size[axis] - ArcsView::kMargin + 7) return false;
      if (axis == 2) continue;
      const std::int32_t from_first = near[axis] + arcs.low[axis];
      const std::int32_t away = from_first > 7 ? from_first - 7 : from_first < 0 ? -from_first : 0;
      squared += away * away;
    }
    return squared <= arcs.reach_squared;
  }

  /// One voxel per lane. All lanes.
  __device__ void takeVoxel(const std::int32_t (&near)[3], bool collides, bool wanted) {
    const unsigned all = __ballot_sync(kAllLanes, wanted);
    if (worse_ + better_ + __popc(all) > kMostVoxels) takeVoxels();
    const unsigned worse = __ballot_sync(kAllLanes, wanted && collides), better = all & ~worse,
                   before = (1u << lane_) - 1u;
    if (wanted) {
      const std::uint32_t code = VoxelNear::code(near[0] * context_.arcs.size[1] + near[1], near[2]);
      (collides ? near_.worse[worse_ + __popc(worse & before)] : near_.better[better_ + __popc(better & before)]) =
          code;
    }
    worse_ += __popc(worse);
    better_ += __popc(better);
  }

  /// Fills a list up to a multiple of kTogether with voxels that are in no point's reach. @return that
  __device__ int filledUp(std::uint32_t* voxels, int count) const {
    const int filled = (count + kTogether - 1) / kTogether * kTogether;
    if (count + lane_ < filled) {
      voxels[count + lane_] = VoxelNear::code((ArcsView::kMargin - 1) * (context_.arcs.size[1] + 1), ArcsView::kMargin);
    }
    return filled;
  }

  /// Applies the voxels that were listed to all points of the block. All lanes.
  __device__ void takeVoxels() {
    const int worse = filledUp(near_.worse, worse_), better = filledUp(near_.better, better_);
    __syncwarp();
    if (worse + better > 0) forEachKnown([&](std::uint32_t id) { followPoint(id, worse, better); });
    worse_ = better_ = 0;
    __syncwarp();
  }

  /// Lists the points of which anything is known. All lanes.
  __device__ void listKnown() {
    const BlockIndexView& index = context_.points.index;
    const std::uint32_t first = index.first[block_], count = index.count[block_];
    for (std::uint32_t from = 0; from < count; from += kWarp) {
      const std::uint32_t n = from + static_cast<std::uint32_t>(lane_);
      const std::uint32_t id = n < count ? index.ids[first + n] : kNoIndex;
      const bool known = id != kNoIndex && isSet(context_.known.counted_bits, id);
      const unsigned all = __ballot_sync(kAllLanes, known);
      if (known) near_.points[points_ + __popc(all & ((1u << lane_) - 1u))] = static_cast<std::uint16_t>(n);
      points_ += __popc(all);
    }
    __syncwarp();
  }
  /// Calls visit(id) with a point of them per lane; kNoIndex: none. All lanes.
  template <class Visit>
  __device__ void forEachKnown(const Visit& visit) const {
    const std::uint32_t first = context_.points.index.first[block_];
    for (int from = 0; from < points_; from += static_cast<int>(kWarp)) {
      visit(from + lane_ < points_ ? context_.points.index.ids[first + near_.points[from + lane_]] : kNoIndex);
    }
  }

  /// One point per lane; kNoIndex: none. All lanes. @param worse, better  multiples of kTogether
  __device__ void followPoint(std::uint32_t id, int worse, int better) const {
    const int words = context_.known.slots.words;
    __syncwarp();  // all have read
    static_assert(kWarp % 4 == 0);
    for (int n = lane_; n < words * static_cast<int>(2 * kWarp / 4); n += static_cast<int>(kWarp)) {
      reinterpret_cast<uint4*>(all_steps)[n] = {0, 0, 0, 0};
    }
    __syncwarp();
    if (id == kNoIndex) return;
    const float* p = context_.points.points.position_L + 3 * std::size_t{id};
    const std::uint32_t note = KnownRow::noteOf(context_.known, id);
    const Coord ijk = voxelOf(p[0], p[1], p[2], context_.inverse_voxel_size);
    const auto column = static_cast<std::uint32_t>((ijk[0] & 7) * context_.arcs.size[1] + (ijk[1] & 7)),
               height = static_cast<std::uint32_t>(ijk[2] & 7);
    int sum = 0;  // what the arcs that cover direction 0 and began before it add up to
    addSteps<1>(near_.worse, worse, column, height, sum);
    addSteps<-1>(near_.better, better, column, height, sum);
    sumUp(sum);
    apply(id, note);
  }

  template <int kBy>
  __device__ void addSteps(const std::uint32_t* voxels, int count, std::uint32_t column, std::uint32_t height,
                           int& sum) const {
    const ArcsOfColumn* const table = context_.arcs.table;
#pragma unroll 1
    for (int first = 0; first < count; first += kTogether) {
      const uint4 codes = *reinterpret_cast<const uint4*>(voxels + first);
      const std::uint32_t code[kTogether] = {codes.x, codes.y, codes.z, codes.w};
      uint4 covering[kTogether];
#pragma unroll
      for (int n = 0; n < kTogether; ++n) {
        covering[n] = __ldg(reinterpret_cast<const uint4*>(table + (VoxelNear::column(code[n]) - column)));
      }
#pragma unroll
      for (int n = 0; n < kTogether; ++n) {
        const ArcsOfColumn& arcs = *reinterpret_cast<const ArcsOfColumn*>(&covering[n]);
        const std::uint32_t at = VoxelNear::height(code[n]) - height;
        if (arcs.first.covers(at)) addArc<kBy>(arcs.first, sum);
        if (arcs.second.covers(at)) addArc<kBy>(arcs.second, sum);
#pragma unroll 1
        for (std::uint32_t more = 0; more < arcs.count; ++more) {
          const CoveringArc& arc = context_.arcs.more[arcs.more + more];
          if (arc.covers(at)) addArc<kBy>(arc, sum);
        }
      }
    }
  }
  template <int kBy>
  __device__ void addArc(const CoveringArc& arc, int& sum) const {
    steps_[arc.begin] = static_cast<std::int8_t>(steps_[arc.begin] + kBy);
    steps_[arc.end] = static_cast<std::int8_t>(steps_[arc.end] - kBy);
    if (arc.end < arc.begin) sum += kBy;
  }

  [[nodiscard]] __device__ std::uint32_t& fourSteps(int n) const {
    return all_steps[n * static_cast<int>(kWarp) + lane_];
  }

  /// Turns this lane's steps into their sums, which are no more than its voxels.
  __device__ void sumUp(int sum) const {
    const int words = 2 * context_.known.slots.words;
#pragma unroll 4
    for (int n = 0; n < words; ++n) {
      const auto four = static_cast<int>(fourSteps(n));
      const int sums[4] = {__dp4a(four, 0x00000001, sum), __dp4a(four, 0x00000101, sum), __dp4a(four, 0x00010101, sum),
                           __dp4a(four, 0x01010101, sum)};
      sum = sums[3];
      fourSteps(n) = __byte_perm(__byte_perm(sums[0], sums[1], 0x0040), __byte_perm(sums[2], sums[3], 0x0040), 0x5410);
    }
  }

  /// The first two of four signed bytes as signed halves of a word.
  [[nodiscard]] static __device__ std::uint32_t firstTwo(std::uint32_t four) {
    const std::uint32_t unsigned_halves = __byte_perm(four ^ 0x8080u, 0, 0x4140);
    return ((unsigned_halves | 0x80008000u) - 0x00800080u) ^ 0x80008000u;
  }

  /// Adds the sums to what is known about this lane's point.
  __device__ void apply(std::uint32_t id, std::uint32_t note) const {
    const KnownSlots& slots = context_.known.slots;
    uint4* const row = reinterpret_cast<uint4*>(KnownRow::countsOf(context_.known, id));
    constexpr int kAtOnce = 4;  // slots are a multiple of that, or as many as words
#pragma unroll 1
    for (int first = 0; first < slots.slots; first += kAtOnce) {
      uint4 counts[kAtOnce];
      int words[kAtOnce];
#pragma unroll
      for (int n = 0; n < kAtOnce; ++n) {
        words[n] = first + n < slots.slots ? slots.wordIn(note, first + n) : -1;
        if (words[n] >= 0) counts[n] = row[first + n];
      }
#pragma unroll
      for (int n = 0; n < kAtOnce; ++n) {
        if (words[n] < 0) continue;
        const std::uint32_t low = fourSteps(2 * words[n]), high = fourSteps(2 * words[n] + 1);
        if ((low | high) == 0) continue;
        counts[n].x = known_count::changedBy(counts[n].x, firstTwo(low));
        counts[n].y = known_count::changedBy(counts[n].y, firstTwo(low >> 16));
        counts[n].z = known_count::changedBy(counts[n].z, firstTwo(high));
        counts[n].w = known_count::changedBy(counts[n].w, firstTwo(high >> 16));
        row[first + n] = counts[n];
      }
    }
  }

  /// Lowers the bounds by what may have become free. That of the best direction is not its count any more. All lanes.
  __device__ void lowerAll() const {
    const KnownSlots& slots = context_.known.slots;
    const std::size_t group = context_.points.groups.of_block[block_];
    const std::uint16_t* const lost =
        any(context_.masks.masks[group].better_tool)
            ? context_.known.lost + group * static_cast<std::size_t>(slots.words * kKnownPerWord)
            : nullptr;
    forEachKnown([&](std::uint32_t id) {
      if (id == kNoIndex) return;
      KnownCounts* const row = KnownRow::countsOf(context_.known, id);
      const PointStateView& points = context_.points.points;
      const int best = points.label[id] == PointLabel::Accessible ? int{points.direction[id]} : -1;
      for (std::uint32_t left = slots.held(KnownRow::noteOf(context_.known, id)); left != 0; left &= left - 1) {
        const int w = __ffs(static_cast<int>(left)) - 1;
        if (lost == nullptr && best / kKnownPerWord != w) continue;
        KnownCounts counts = row[slots.slotOf(w)];
#pragma unroll
        for (int n = 0; n < kKnownPerWord; ++n) {
          const int d = kKnownPerWord * w + n;
          if (lost != nullptr) counts.of[n] = known_count::loweredBy(counts.of[n], lost[d]);
          if (d == best) counts.of[n] |= known_count::kUnknown;
        }
        row[slots.slotOf(w)] = counts;
      }
    });
  }

  const FollowContext& context_;
  VoxelsNear& near_;
  std::uint32_t block_;
  int lane_;
  const std::int32_t* leaf_;
  std::int8_t* steps_;  ///< of this lane
  int points_ = 0;      ///< of which anything is known
  int worse_ = 0, better_ = 0;
};

/// One warp per block of points.
__global__ void __launch_bounds__(kWarp) followFlips(const __grid_constant__ FollowContext context) {
  __shared__ VoxelsNear near;
  const std::uint32_t block = blockIdx.x;
  const int lane = static_cast<int>(threadIdx.x);
  const std::uint32_t group = context.points.groups.of_block[block];
  if (context.masks.affected[group] == 0) return;
  const GroupMasks& masks = context.masks.masks[group];
  if (any(masks.better_tool) || any(masks.worse_tool)) BlockFollower(context, block, near, lane).followAll();
}

}  // namespace

void launchFollowFlips(const FollowContext& context, cudaStream_t stream) {
  const std::uint32_t blocks = context.points.index.blocks;
  if (blocks == 0 || context.flips.by_layer == nullptr) return;
  const std::size_t bytes = 2 * static_cast<std::size_t>(context.known.slots.words) * kWarp * sizeof(std::uint32_t);
  followFlips<<<blocks, kWarp, bytes, stream>>>(context);
  checkLaunch("followFlips");
}

}  // namespace accessvdb::kernels
