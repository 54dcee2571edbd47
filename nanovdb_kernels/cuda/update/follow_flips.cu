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
/// Voxels whose arcs are on their way, to hide memory latency.
constexpr int kTogether = 4;

/// Where more voxels than this flipped in the leaves around a block for each point that a warp's lanes take together,
/// as on new ground, bounds are only lowered: testing those points again costs less than following.
constexpr std::uint32_t kMostPerPoint = 40;

/// A flipped voxel near a block, seen from where ArcsView begins for a point in the block's first voxel, in one word.
struct VoxelNear {
  static constexpr int kHeightBits = 9, kColumnAt = kHeightBits + 1;

  [[nodiscard]] static __device__ std::uint32_t code(std::int32_t column, std::int32_t height, bool collides) {
    return static_cast<std::uint32_t>(column) << kColumnAt | (collides ? 0u : 1u << kHeightBits) |
           static_cast<std::uint32_t>(height);
  }
  [[nodiscard]] static __device__ std::uint32_t column(std::uint32_t code) { return code >> kColumnAt; }
  [[nodiscard]] static __device__ std::uint32_t height(std::uint32_t code) { return code & ((1u << kHeightBits) - 1); }
  /// By how much it changes a count.
  [[nodiscard]] static __device__ int step(std::uint32_t code) {
    return 1 - static_cast<int>(code >> (kHeightBits - 1) & 2u);
  }
};

/// What a warp shares of a block.
struct BlockNear {
  alignas(16) std::uint32_t voxels[kMostVoxels + 2 * kTogether];  ///< near it: VoxelNear::code
  std::uint16_t points[kMostInBlock];  ///< places in the block's list of those of which any bound is known
};

/// The steps of a warp: one byte for each direction and lane (stepPlace).
extern __shared__ __align__(16) std::uint32_t all_steps[];

class BlockFollower {
 public:
  /// @param near  shared by the warp
  __device__ BlockFollower(const FollowContext& context, std::uint32_t block, BlockNear& near, int lane)
      : context_(context),
        near_(near),
        block_(block),
        lane_(lane),
        leaf_(context.points.index.leaf + 3 * std::size_t{block}) {}

  /// All lanes.
  __device__ void followAll() {
    const std::uint32_t points = countKnown();
    if (points == 0) return;
    const ArcsView& arcs = context_.arcs;
    std::int32_t low[3], high[3];  // [leaves]
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = (leaf_[axis] * 8 + arcs.low[axis] + ArcsView::kMargin) >> 3;
      high[axis] = (leaf_[axis] * 8 + arcs.low[axis] + arcs.size[axis] - ArcsView::kMargin + 6) >> 3;
    }
    std::uint32_t voxels = 0;
    forEachTile(low, high, [&](const Tile& tile, bool /*last*/) {
      voxels += __reduce_add_sync(kAllLanes, tile.end - tile.begin);
    });
    if (voxels == 0) return;
    if (std::uint64_t{voxels} * ((points + kWarp - 1) / kWarp) > kMostPerPoint * points) return lowerAll();
    listKnown();
    forEachTile(low, high, [&](const Tile& tile, bool last) { takeTiles(tile, last); });
  }

 private:
  /// The voxels of some layers of a tile; one tile per lane.
  struct Tile {
    std::int32_t origin[3] = {0, 0, 0};  ///< [voxels] its first one, from where ArcsView begins
    std::uint32_t begin = 0, end = 0;    ///< of FlipsView::by_layer
  };

  /// Calls visit(tile, whether these are the last ones) with a tile per lane. All lanes. @param low, high  [leaves]
  /// inclusive
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
      visit(tile, base + static_cast<int>(kWarp) >= count);
    }
  }

  /// Lists the voxels of one tile per lane, and applies what was listed when the list is full, or these tiles are the
  /// last ones. All lanes.
  __device__ void takeTiles(const Tile& mine, bool last) {
    const std::uint32_t end = sumUpTo(mine.end - mine.begin, lane_), all = __shfl_sync(kAllLanes, end, 31);
    // One turn more than there are voxels: a single place where they are applied keeps the kernel in the cache.
#pragma unroll 1
    for (std::uint32_t from = 0; from < all || last; from += kWarp) {
      const bool over = from >= all;
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
      const bool wanted = at < all && isNear(near);
      const unsigned all_wanted = __ballot_sync(kAllLanes, wanted);
      if (over || voxels_ + __popc(all_wanted) > kMostVoxels) takeVoxels();
      if (over) return;
      if (wanted) {
        near_.voxels[voxels_ + __popc(all_wanted & ((1u << lane_) - 1u))] =
            VoxelNear::code(near[0] * context_.arcs.size[1] + near[1], near[2], (code & 1u) != 0);
      }
      voxels_ += __popc(all_wanted);
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

  /// Applies the voxels that were listed to all points of the block. All lanes.
  __device__ void takeVoxels() {
    if (voxels_ == 0) return;
    // Those that are read ahead, or fill up, are in no point's reach.
    if (lane_ < 2 * kTogether) {
      near_.voxels[voxels_ + lane_] =
          VoxelNear::code((ArcsView::kMargin - 1) * (context_.arcs.size[1] + 1), ArcsView::kMargin, true);
    }
    __syncwarp();
    const std::uint32_t first = context_.points.index.first[block_];
    for (int from = 0; from < points_; from += static_cast<int>(kWarp)) {
      const int n = from + lane_;
      followPoint(n < points_ ? context_.points.index.ids[first + near_.points[n]] : kNoIndex);
    }
    voxels_ = 0;
    __syncwarp();
  }

  /// Stirs the others. All lanes. @return the number of points of which anything is known
  __device__ std::uint32_t countKnown() const {
    std::uint32_t known = 0;
    forEachInBlock([&](std::uint32_t /*n*/, std::uint32_t id) {
      if (isSet(context_.known.counted_bits, id)) {
        ++known;
      } else {
        stir(id);
      }
    });
    return __reduce_add_sync(kAllLanes, known);
  }
  /// Lists the points of which anything is known, those above each other together: their arcs lie side by side, so that
  /// lanes that read them share cache lines. All lanes.
  __device__ void listKnown() {
    constexpr int kColumns = 64;
    std::uint32_t* const begin = all_steps;  // [column]; not in use yet
    for (int n = lane_; n < kColumns; n += static_cast<int>(kWarp)) begin[n] = 0;
    __syncwarp();
    forEachColumn([&](std::uint32_t /*n*/, std::uint32_t column) { atomicAdd(begin + column, 1u); });
    __syncwarp();
    static_assert(kColumns == 2 * kWarp);
    const std::uint32_t first = begin[2 * lane_], both = first + begin[2 * lane_ + 1], end = sumUpTo(both, lane_);
    points_ = static_cast<int>(__shfl_sync(kAllLanes, end, 31));
    __syncwarp();
    begin[2 * lane_] = end - both;
    begin[2 * lane_ + 1] = end - both + first;
    __syncwarp();
    forEachColumn([&](std::uint32_t n, std::uint32_t column) {
      near_.points[atomicAdd(begin + column, 1u)] = static_cast<std::uint16_t>(n);
    });
    __syncwarp();
  }
  /// Calls visit(place in the block's list, id) with each point.
  template <class Visit>
  __device__ void forEachInBlock(const Visit& visit) const {
    const BlockIndexView& index = context_.points.index;
    const std::uint32_t first = index.first[block_], count = index.count[block_];
    for (std::uint32_t n = static_cast<std::uint32_t>(lane_); n < count; n += kWarp) visit(n, index.ids[first + n]);
  }
  /// Calls visit(place in the block's list, column in the block) with the points of which anything is known.
  template <class Visit>
  __device__ void forEachColumn(const Visit& visit) const {
    forEachInBlock([&](std::uint32_t n, std::uint32_t id) {
      if (!isSet(context_.known.counted_bits, id)) return;
      const float* p = context_.points.points.position_L + 3 * std::size_t{id};
      const Coord ijk = voxelOf(p[0], p[1], p[2], context_.inverse_voxel_size);
      visit(n, static_cast<std::uint32_t>((ijk[0] & 7) << 3 | (ijk[1] & 7)));
    });
  }

  /// Notes that flips may have changed the collisions of a point so that something is due there.
  __device__ void stir(std::uint32_t id) const { atomicOr(context_.known.stirred_bits + (id >> 5), 1u << (id & 31)); }

  /// One point per lane; kNoIndex: none. All lanes.
  __device__ void followPoint(std::uint32_t id) const {
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
    const int sum = addSteps(static_cast<std::uint32_t>((ijk[0] & 7) * context_.arcs.size[1] + (ijk[1] & 7)),
                             static_cast<std::uint32_t>(ijk[2] & 7));
    // Where collisions only became more, but for the best direction, nothing is due.
    const PointStateView& points = context_.points.points;
    const bool any_fewer = sumUp(sum);
    if (any_fewer || (points.label[id] == PointLabel::Accessible && *step(stepPlace(points.direction[id])) != 0)) {
      stir(id);
    }
    apply(id, note);
  }

  /// @param place  stepPlace()  @return a step of this lane
  [[nodiscard]] __device__ std::int8_t* step(std::uint32_t place) const {
    return reinterpret_cast<std::int8_t*>(all_steps) + (place | static_cast<std::uint32_t>(4 * lane_));
  }
  [[nodiscard]] __device__ uint4 arcsOf(std::uint32_t code, std::uint32_t column) const {
    return __ldg(reinterpret_cast<const uint4*>(context_.arcs.table + (VoxelNear::column(code) - column)));
  }

  /// Adds up the steps of all voxels for a point of this lane. @param column, height  where the point is in its block
  /// @return what the arcs that cover direction 0 and began before it add up to
  [[nodiscard]] __device__ int addSteps(std::uint32_t column, std::uint32_t height) const {
    int sum = 0;
    uint4 next = *reinterpret_cast<const uint4*>(near_.voxels);
    uint4 covering[kTogether] = {arcsOf(next.x, column), arcsOf(next.y, column), arcsOf(next.z, column),
                                 arcsOf(next.w, column)};
#pragma unroll 1
    for (int first = 0; first < voxels_; first += kTogether) {
      const std::uint32_t code[kTogether] = {next.x, next.y, next.z, next.w};
      next = *reinterpret_cast<const uint4*>(near_.voxels + first + kTogether);
      const std::uint32_t ahead[kTogether] = {next.x, next.y, next.z, next.w};
#pragma unroll
      for (int n = 0; n < kTogether; ++n) {
        const uint4 arcs = covering[n];
        covering[n] = arcsOf(ahead[n], column);
        addArcs(arcs, code[n], height, sum);
      }
    }
    return sum;
  }
  /// @param arcs  an ArcsOfColumn
  __device__ void addArcs(const uint4& arcs, std::uint32_t code, std::uint32_t height, int& sum) const {
    const ArcsOfColumn& of_column = *reinterpret_cast<const ArcsOfColumn*>(&arcs);
    const std::uint32_t at = VoxelNear::height(code) - height;
    const int by = VoxelNear::step(code);
    if (of_column.first.covers(at)) addArc(of_column.first, by, sum);
    if (of_column.second.covers(at)) addArc(of_column.second, by, sum);
#pragma unroll 1
    for (std::uint32_t more = 0; more < of_column.count; ++more) {
      const CoveringArc& arc = context_.arcs.more[of_column.more + more];
      if (arc.covers(at)) addArc(arc, by, sum);
    }
  }
  __device__ void addArc(const CoveringArc& arc, int by, int& sum) const {
    std::int8_t *const begin = step(arc.begin), *const end = step(arc.end);
    *begin = static_cast<std::int8_t>(*begin + by);
    *end = static_cast<std::int8_t>(*end - by);
    if (arc.end < arc.begin) sum += by;
  }

  [[nodiscard]] __device__ std::uint32_t& fourSteps(int n) const {
    return all_steps[n * static_cast<int>(kWarp) + lane_];
  }

  /// Turns this lane's steps into their sums, which are no more than its voxels. @return whether any is below 0
  [[nodiscard]] __device__ bool sumUp(int sum) const {
    const int words = 2 * context_.known.slots.words;
    std::uint32_t all = 0;
#pragma unroll 2
    for (int n = 0; n < words; ++n) {
      const auto four = static_cast<int>(fourSteps(n));
      const int sums[4] = {__dp4a(four, 0x00000001, sum), __dp4a(four, 0x00000101, sum), __dp4a(four, 0x00010101, sum),
                           __dp4a(four, 0x01010101, sum)};
      sum = sums[3];
      const std::uint32_t four_sums =
          __byte_perm(__byte_perm(sums[0], sums[1], 0x0040), __byte_perm(sums[2], sums[3], 0x0040), 0x5410);
      all |= four_sums;
      fourSteps(n) = four_sums;
    }
    return (all & 0x80808080u) != 0;
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
    constexpr int kAtOnce = 2;  // slots are a multiple of that, or as many as words
#pragma unroll 1
    for (int first = 0; first < slots.slots; first += kAtOnce) {
      uint4 counts[kAtOnce];
      std::uint32_t low[kAtOnce], high[kAtOnce];
#pragma unroll
      for (int n = 0; n < kAtOnce; ++n) {
        const int word = first + n < slots.slots ? slots.wordIn(note, first + n) : -1;
        low[n] = word >= 0 ? fourSteps(2 * word) : 0;
        high[n] = word >= 0 ? fourSteps(2 * word + 1) : 0;
        if ((low[n] | high[n]) != 0) counts[n] = row[first + n];
      }
#pragma unroll
      for (int n = 0; n < kAtOnce; ++n) {
        if ((low[n] | high[n]) == 0) continue;
        counts[n].x = known_count::changedBy(counts[n].x, firstTwo(low[n]));
        counts[n].y = known_count::changedBy(counts[n].y, firstTwo(low[n] >> 16));
        counts[n].z = known_count::changedBy(counts[n].z, firstTwo(high[n]));
        counts[n].w = known_count::changedBy(counts[n].w, firstTwo(high[n] >> 16));
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
    forEachInBlock([&](std::uint32_t /*n*/, std::uint32_t id) {
      if (!isSet(context_.known.counted_bits, id)) return;
      stir(id);
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
  BlockNear& near_;
  std::uint32_t block_;
  int lane_;
  const std::int32_t* leaf_;
  int points_ = 0;  ///< of which anything is known
  int voxels_ = 0;  ///< listed
};

/// One warp per block of points.
__global__ void __launch_bounds__(kWarp) followFlips(const __grid_constant__ FollowContext context) {
  __shared__ BlockNear near;
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
