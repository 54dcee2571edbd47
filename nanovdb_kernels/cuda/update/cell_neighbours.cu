// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The neighbourhoods of moved points that have had one before, cell by cell: the points of a cell share the positions
/// around it, which a block of threads gathers once. The same neighbours as in nearest_points.cu, which takes the
/// points for which this does not work out.
///
/// Their positions are integers, from the corner of the box around the cell (hostdev/near_positions.h). A point whose
/// own position cannot be one is left over.
#include <cstddef>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/near_positions.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4, kThreads = kWarps * kWarp;
/// Blocks that a multiprocessor should hold: this limits the registers.
constexpr unsigned kBlocksEach = 7;
/// Most points around a cell.
constexpr int kMostNear = 1024;
/// Most points listed for one of its points, and how many of them a lane has.
constexpr int kMostListed = 256, kEach = kMostListed / static_cast<int>(kWarp);
/// Neighbourhoods that are collected before their normals are made, one per thread.
constexpr std::uint32_t kBatch = 64;
constexpr int kCells = 8;  ///< of 4^3 voxels per block

/// Sums of a point's neighbours. Shared memory has no constructors.
struct RawSums {
  std::int64_t values[sizeof(NeighbourSums) / sizeof(std::int64_t)];
  [[nodiscard]] __device__ NeighbourSums& sums() { return reinterpret_cast<NeighbourSums&>(values); }
};
struct Batch {
  RawSums of[kBatch];
  std::uint32_t at[kBatch];  ///< index of the moved point
  std::uint32_t count;
};

/// Shared memory of a block of threads.
struct Scratch {
  std::int32_t near[3][kMostNear];  ///< positions around the cell, from the corner of its box
  std::uint32_t near_id[kMostNear];
  std::uint16_t listed[kWarps][kMostListed];
  Batch batch;
  std::uint16_t order[kMostMovedInBlock];  ///< the block's moved points, cell by cell
  std::uint32_t begin[kCells + 1];
  std::uint32_t first, count;  ///< MovedBlock
  // The box around the cell.
  long long origin[3];
  std::uint32_t width[3];
  std::int32_t leaf_low[3], leaf_side[3];
  double per_metre;  ///< PositionFractions
  int bits;
  std::uint32_t num_near;
  bool fits;              ///< whether positions around the cell do
  std::uint32_t inexact;  ///< not 0: a point without exact offsets is around it
};

/// Makes the normals of a batch, one per thread. Not inlined: it is large.
__device__ __noinline__ void makeNormals(const PointsView& points, const MovedView& moved, const MovedRange& range,
                                         Batch& batch) {
  if (threadIdx.x >= batch.count) return;
  const std::uint32_t at = batch.at[threadIdx.x];
  const float* const to_sensor = points.state.to_sensor_L + 3 * static_cast<std::size_t>(moved.ids[at]);
  float normal[3];
  neighbourNormal(batch.of[threadIdx.x].sums(), to_sensor, normal);
  for (int axis = 0; axis < 3; ++axis) range.to[at - range.begin].normal[axis] = normal[axis];
}

/// Orders like the floats.
__device__ std::int32_t orderedBits(float value) {
  const std::int32_t bits = __float_as_int(value);
  return bits ^ ((bits >> 31) & 0x7fffffff);
}
__device__ float fromOrderedBits(std::int32_t bits) { return __int_as_float(bits ^ ((bits >> 31) & 0x7fffffff)); }

/// Makes the neighbourhoods of a block's moved points. All threads of a block share one.
class CellSearch {
 public:
  __device__ CellSearch(const PointsView& points, const MovedView& moved, const MovedRange& range, Scratch& scratch)
      : points_(points),
        moved_(moved),
        range_(range),
        s_(scratch),
        warp_(threadIdx.x / kWarp),
        lane_(static_cast<int>(threadIdx.x % kWarp)) {}

  /// Makes those of one block, in scratch. All threads call it.
  __device__ void run() {
    sortByCell();
    // The whole block at once, or cell by cell if too many points are around it.
#pragma unroll 1
    for (int cell = -1; cell < kCells; ++cell) {
      const std::uint32_t begin = cell < 0 ? 0 : s_.begin[cell], end = cell < 0 ? s_.count : s_.begin[cell + 1];
      if (begin == end) continue;
      if (warp_ == 0) makeBox(begin, end);
      __syncthreads();
      if (s_.fits) gather();
      __syncthreads();
      // The whole cell is left over, or the block divided.
      const bool is_left = !s_.fits || s_.inexact != 0 || s_.num_near > kMostNear;
      if (cell < 0 && is_left) {
        __syncthreads();  // all have read
        continue;
      }
      takePoints(begin, end, is_left);
      if (cell < 0) return;
    }
  }
  /// Makes the normals of what was collected, one per thread. All threads call it.
  __device__ void finish() {
    makeNormals(points_, moved_, range_, s_.batch);
    __syncthreads();
    if (threadIdx.x == 0) s_.batch.count = 0;
    __syncthreads();
    collected_ = 0;
  }

 private:
  [[nodiscard]] __device__ std::uint32_t idOf(std::uint32_t at) const { return moved_.ids[at]; }
  [[nodiscard]] __device__ const float* meanOf(std::uint32_t id) const {
    return points_.state.mean_L + 3 * static_cast<std::size_t>(id);
  }

  /// Largest squared distance that is searched. @param reach_m  of the last time
  [[nodiscard]] __device__ std::int64_t boundFor(float reach_m) const {
    const auto steps = static_cast<std::int64_t>(neighbourSearchSteps(reach_m, points_.rule.steps_per_m));
    return min(steps * steps, points_.rule.radius_squared);
  }

  /// Takes points [begin, end) of the order, one warp each. All threads call it.
  __device__ void takePoints(std::uint32_t begin, std::uint32_t end, bool is_left) {
#pragma unroll 1
    for (std::uint32_t first = begin; first < end; first += kBatch) {
      const std::uint32_t last = min(end, first + kBatch);
      if (collected_ + (last - first) > kBatch) finish();
      collected_ += last - first;
#pragma unroll 1
      for (std::uint32_t n = first + warp_; n < last; n += kWarps) {
        const std::uint32_t at = s_.first + s_.order[n];
        if (is_left || !search(at)) {
          if (lane_ == 0) range_.left[atomicAdd(&moved_.counters->left, 1u)] = at;
        }
      }
      __syncthreads();  // what they have read is overwritten next
    }
  }

  /// Orders the block's moved points by cell.
  __device__ void sortByCell() {
    const std::uint32_t count = s_.count;
    if (threadIdx.x <= kCells) s_.begin[threadIdx.x] = 0;
    __syncthreads();
    const auto cellOf = [&](std::uint32_t n) {
      const float* mean = meanOf(idOf(s_.first + n));
      std::uint32_t cell = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const auto voxel =
            static_cast<std::int32_t>(floor(static_cast<double>(mean[axis]) * points_.rule.inverse_voxel_size + 0.5));
        cell |= static_cast<std::uint32_t>(voxel >> 2 & 1) << axis;
      }
      return cell;
    };
#pragma unroll 1
    for (std::uint32_t n = threadIdx.x; n < count; n += kThreads) atomicAdd(&s_.begin[cellOf(n)], 1u);
    __syncthreads();
    if (threadIdx.x == 0) {
      std::uint32_t end = 0;
#pragma unroll 1
      for (int cell = 0; cell <= kCells; ++cell) s_.begin[cell] = end += s_.begin[cell];
    }
    __syncthreads();
    // From their ends to their beginnings.
#pragma unroll 1
    for (std::uint32_t n = threadIdx.x; n < count; n += kThreads) {
      s_.order[atomicSub(&s_.begin[cellOf(n)], 1u) - 1] = static_cast<std::uint16_t>(n);
    }
    __syncthreads();
  }

  /// Makes the box that holds all points in question for [begin, end) of the order. One warp calls it.
  __device__ void makeBox(std::uint32_t begin, std::uint32_t end) {
    constexpr std::int32_t kMost = 0x7fffffff;
    std::int32_t low[3] = {kMost, kMost, kMost}, high[3] = {-kMost, -kMost, -kMost}, reach = 0;
#pragma unroll 1
    for (std::uint32_t n = begin + static_cast<std::uint32_t>(lane_); n < end; n += kWarp) {
      const std::uint32_t id = idOf(s_.first + s_.order[n]);
      const float* mean = meanOf(id);
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = min(low[axis], orderedBits(mean[axis]));
        high[axis] = max(high[axis], orderedBits(mean[axis]));
      }
      reach = max(reach, __float_as_int(points_.state.reach_m[id]));  // not negative
    }
    reach = __reduce_max_sync(kAllLanes, reach);
    const double reach_steps = sqrt(static_cast<double>(boundFor(__int_as_float(reach)))) + 2;
    double my_low = 0, my_high = 0;  // [steps] of axis `lane`
    for (int axis = 0; axis < 3; ++axis) {
      const float all_low = fromOrderedBits(__reduce_min_sync(kAllLanes, low[axis])),
                  all_high = fromOrderedBits(__reduce_max_sync(kAllLanes, high[axis]));
      if (lane_ != axis) continue;
      my_low = static_cast<double>(all_low) * points_.rule.steps_per_m - reach_steps;
      my_high = static_cast<double>(all_high) * points_.rule.steps_per_m + reach_steps;
    }
    double width_steps = 0;
    for (int axis = 0; axis < 3; ++axis) {
      width_steps = fmax(width_steps, __shfl_sync(kAllLanes, my_high - my_low, axis));
    }
    const auto fractions = PositionFractions::forWidth(width_steps + 2, points_.rule.steps_per_m);
    const double per_step = static_cast<double>(1 << fractions.bits);
    if (lane_ == 0) {
      s_.num_near = 0;
      s_.fits = fractions.bits > 0;
      s_.inexact = 0;
      s_.bits = fractions.bits;
      s_.per_metre = fractions.per_metre;
    }
    if (lane_ < 3) {
      const long long origin = __double2ll_rd(my_low * per_step);
      s_.origin[lane_] = origin;
      s_.width[lane_] = static_cast<std::uint32_t>(__double2ll_ru(my_high * per_step) - origin);
      // In voxels, of which leaf l holds [8 l - 1/2, 8 l + 7 1/2).
      const double voxels_per_step = points_.rule.inverse_voxel_size / points_.rule.steps_per_m;
      const auto leafAt = [&](double steps, double rounding) {
        return static_cast<std::int32_t>(floor((steps * voxels_per_step + 0.5 + rounding) / 8));
      };
      s_.leaf_low[lane_] = leafAt(my_low, -kMeanRoundingVoxels);
      s_.leaf_side[lane_] = leafAt(my_high, kMeanRoundingVoxels) - s_.leaf_low[lane_] + 1;
    }
  }

  /// Gathers the points in the box. All threads call it.
  __device__ void gather() {
    const std::int32_t* const side = s_.leaf_side;
    const int all = side[0] * side[1] * side[2];
    // Neighbouring leaves go to different warps, which share the work that way.
#pragma unroll 1
    for (int base = 0; base < all; base += static_cast<int>(kThreads)) {
      const int n = base + lane_ * static_cast<int>(kWarps) + static_cast<int>(warp_);
      std::uint32_t first = 0, count = 0;
      if (n < all) {
        const std::uint32_t block =
            points_.index.find(s_.leaf_low[0] + n / (side[1] * side[2]), s_.leaf_low[1] + n / side[2] % side[1],
                               s_.leaf_low[2] + n % side[2]);
        if (block != kNoIndex) {
          first = points_.index.first[block];
          count = points_.index.count[block];
        }
      }
#pragma unroll 1
      for (unsigned left = __ballot_sync(kAllLanes, count > 0); left != 0; left &= left - 1) {
        const int from = __ffs(static_cast<int>(left)) - 1;
        const std::uint32_t begin = __shfl_sync(kAllLanes, first, from), size = __shfl_sync(kAllLanes, count, from);
#pragma unroll 1
        for (std::uint32_t i = 0; i < size; i += kWarp) {
          gatherOne(begin + i, i + static_cast<std::uint32_t>(lane_) < size);
        }
      }
    }
  }
  /// One point per lane.
  __device__ void gatherOne(std::uint32_t first, bool is_there) {
    std::uint32_t id = 0;
    std::int32_t at[3] = {0, 0, 0};
    if (is_there) {
      id = points_.index.ids[first + static_cast<std::uint32_t>(lane_)];
      const float* mean = meanOf(id);
      for (int axis = 0; axis < 3; ++axis) {
        if (!hasExactOffsets(mean[axis])) atomicOr(&s_.inexact, 1u);
        const std::int64_t from = fractions().of(mean[axis]) - s_.origin[axis];
        is_there = is_there && static_cast<unsigned long long>(from) <= s_.width[axis];
        at[axis] = static_cast<std::int32_t>(from);
      }
    }
    const unsigned all = __ballot_sync(kAllLanes, is_there);
    if (all == 0) return;
    std::uint32_t place = 0;
    if (lane_ == 0) place = atomicAdd(&s_.num_near, static_cast<std::uint32_t>(__popc(all)));
    place = __shfl_sync(kAllLanes, place, 0) + static_cast<std::uint32_t>(__popc(all & ((1u << lane_) - 1u)));
    if (!is_there || place >= kMostNear) return;
    for (int axis = 0; axis < 3; ++axis) s_.near[axis][place] = at[axis];
    s_.near_id[place] = id;
  }

  [[nodiscard]] __device__ PositionFractions fractions() const { return {s_.bits, s_.per_metre}; }
  /// The offset of a point around the cell from a centre.
  [[nodiscard]] __device__ NeighbourOffset offsetOf(int n, const std::int32_t* centre) const {
    const auto steps = [&](int axis) { return fractions().offset(centre[axis], s_.near[axis][n]); };
    return {steps(0), steps(1), steps(2)};
  }
  [[nodiscard]] __device__ std::int64_t squaredOf(int n, const std::int32_t* centre) const {
    return offsetOf(n, centre).squared();
  }

  /// Finds the neighbours of a moved point with one warp, and stores all of its neighbourhood but the normal.
  /// @return false if the point is left over
  __device__ bool search(std::uint32_t at) {
    const NeighbourRuleView& rule = points_.rule;
    const std::uint32_t id = idOf(at);
    const float* mean = meanOf(id);
    std::int32_t centre[3];
    bool is_whole = true;
    for (int axis = 0; axis < 3; ++axis) {
      is_whole = is_whole && fractions().areExactAt(mean[axis]);
      centre[axis] = static_cast<std::int32_t>(fractions().of(mean[axis]) - s_.origin[axis]);
    }
    if (!is_whole) return false;
    const std::int64_t bound = boundFor(points_.state.reach_m[id]);
    const int listed = list(centre, bound), wanted = rule.neighbours;
    __syncwarp();  // also if the point is left over: the next one's list is written where this one's was
    if (listed > kMostListed || (listed < wanted && bound < rule.radius_squared)) return false;
#pragma unroll
    for (int i = 0; i < kEach; ++i) {
      squared_[i] = squaredOf(listedAt(i), centre);
      if (i * static_cast<int>(kWarp) + lane_ >= listed) squared_[i] = kNone;
    }
    Bound least = {bound, kNoIndex, listed, listed};
    std::uint32_t nearest = 0, sharing = 0;
    // The farthest neighbour is often as far away as the last time (neighbourReach_m).
    const double last_steps = static_cast<double>(points_.state.reach_m[id]) * rule.steps_per_m - 1.9;
    auto guess = static_cast<std::int64_t>(last_steps * last_steps);
#pragma unroll 1
    for (const bool shares : {false, true}) {
      const int count = shares ? rule.view_neighbours : wanted;
      if (least.count > count) least = count > 0 ? leastOf(least, count, guess) : Bound{-1, kNoIndex, 0, listed};
      guess = -1;
      (shares ? sharing : nearest) = listedIn(least);
    }
    std::uint32_t place = 0;
    if (lane_ == 0) {
      place = atomicAdd(&s_.batch.count, 1u);
      s_.batch.at[place] = at;
    }
    sum(centre, nearest, s_.batch.of[__shfl_sync(kAllLanes, place, 0)].sums());
    Neighbourhood& out = range_.to[at - range_.begin];
    const std::int64_t farthest = listed < wanted ? rule.radius_squared : farthestOf(nearest);
    if (lane_ == 0) out.reach_m = neighbourReach_m(farthest, rule.steps_per_m);
    storeSeen(id, sharing, out.seen);
    __syncwarp();  // the list is overwritten next
    return true;
  }

  /// Lists the points up to a squared distance. @return their number, even if not all fit
  __device__ int list(const std::int32_t* centre, std::int64_t bound) const {
    int count = 0;
    const int near = static_cast<int>(s_.num_near);
    for (int first = 0; first < near; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      const bool is_listed = n < near && squaredOf(n, centre) <= bound;
      const unsigned all = __ballot_sync(kAllLanes, is_listed);
      const int place = count + __popc(all & ((1u << lane_) - 1u));
      if (is_listed && place < kMostListed) s_.listed[warp_][place] = static_cast<std::uint16_t>(n);
      count += __popc(all);
    }
    return count;
  }

  /// Bounds the `count` smallest of the list by (squared, id): squared < bound.squared, or equal and id <= bound.id.
  struct Bound {
    std::int64_t squared;
    std::uint32_t id;
    int count;   ///< of points that it holds
    int listed;  ///< length of the list
  };
  /// Which of this lane's points of the list it holds, one bit each.
  [[nodiscard]] __device__ std::uint32_t listedIn(const Bound& bound) const {
    std::uint32_t inside = 0, ties = 0;
#pragma unroll
    for (int i = 0; i < kEach; ++i) {
      inside |= (squared_[i] < bound.squared ? 1u : 0u) << i;
      ties |= (squared_[i] == bound.squared ? 1u : 0u) << i;
    }
#pragma unroll 1
    for (; ties != 0; ties &= ties - 1) {
      if (idOfListed(__ffs(static_cast<int>(ties)) - 1) <= bound.id) inside |= ties & (0u - ties);
    }
    return inside;
  }
  /// This lane's i-th point of the list; beyond its end, any one.
  [[nodiscard]] __device__ int listedAt(int i) const {
    return min(static_cast<int>(s_.listed[warp_][i * static_cast<int>(kWarp) + lane_]), kMostNear - 1);
  }
  [[nodiscard]] __device__ std::uint32_t idOfListed(int i) const { return s_.near_id[listedAt(i)]; }

  /// @param upper  holds more than `wanted`, all with different squared distances or not
  /// @param guess  of the bound; negative: none
  __device__ Bound leastOf(const Bound& upper, int wanted, std::int64_t guess) const {
    std::int64_t low = -1, high = upper.squared;  // `wanted` lies between their counts
    int count_low = 0, count_high = upper.count;
#pragma unroll 1
    for (bool halves = false; high - low > 1; halves = !halves) {
      // Nearly as many per step everywhere: a share of the steps is close, but only halving is sure to end.
      std::int64_t middle = guess;
      if (middle <= low || middle >= high) {
        const float share = static_cast<float>(wanted - count_low) / static_cast<float>(count_high - count_low);
        const auto steps =
            halves ? (high - low) / 2 : static_cast<std::int64_t>(static_cast<float>(high - low) * share);
        middle = low + (steps < 1 ? 1 : steps >= high - low ? high - low - 1 : steps);
      }
      guess = -1;
      unsigned mine = 0;
#pragma unroll
      for (int i = 0; i < kEach; ++i) {
        if (i * static_cast<int>(kWarp) < upper.listed) mine += squared_[i] <= middle ? 1 : 0;
      }
      const int total = static_cast<int>(__reduce_add_sync(kAllLanes, mine));
      if (total == wanted) return {middle, kNoIndex, wanted, upper.listed};
      if (total > wanted) {
        high = middle;
        count_high = total;
      } else {
        low = middle;
        count_low = total;
      }
    }
    return {high, leastIds(high, wanted - count_low), wanted, upper.listed};
  }
  /// Of several at exactly this distance, lower ids first. @return the id of the last one
  __device__ std::uint32_t leastIds(std::int64_t squared, int wanted) const {
    std::uint32_t low = 0, high = kNoIndex;
#pragma unroll 1
    while (low < high) {
      const std::uint32_t middle = low + (high - low) / 2;
      unsigned mine = 0;
#pragma unroll
      for (int i = 0; i < kEach; ++i) mine += squared_[i] == squared && idOfListed(i) <= middle ? 1 : 0;
      if (static_cast<int>(__reduce_add_sync(kAllLanes, mine)) >= wanted) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    return low;
  }

  /// @return the largest squared distance of some points of the list
  [[nodiscard]] __device__ std::int64_t farthestOf(std::uint32_t some) const {
    std::int64_t most = 0;
#pragma unroll
    for (int i = 0; i < kEach; ++i) {
      if ((some >> i & 1u) != 0 && squared_[i] > most) most = squared_[i];
    }
    const auto high = static_cast<std::uint32_t>(most >> 32);
    const std::uint32_t all_high = __reduce_max_sync(kAllLanes, high);
    const std::uint32_t low = high == all_high ? static_cast<std::uint32_t>(most) : 0;
    return static_cast<std::int64_t>(std::uint64_t{all_high} << 32 | __reduce_max_sync(kAllLanes, low));
  }

  /// Adds up a value of each lane.
  [[nodiscard]] __device__ static std::int64_t sumOfWarp(std::int64_t mine) {
    // At most kEach products of offsets of at most 2^20 steps each.
    constexpr int kLowBits = 22;
    const auto low = static_cast<std::uint32_t>(mine) & ((1u << kLowBits) - 1u);
    const std::uint32_t all_low = __reduce_add_sync(kAllLanes, low);
    const int all_high = __reduce_add_sync(kAllLanes, static_cast<int>(mine >> kLowBits));
    return (static_cast<std::int64_t>(all_high) << kLowBits) + all_low;
  }
  __device__ void sum(const std::int32_t* centre, std::uint32_t nearest, NeighbourSums& out) const {
    NeighbourSums mine;
#pragma unroll 1
    for (; nearest != 0; nearest &= nearest - 1) {
      mine.add(offsetOf(listedAt(__ffs(static_cast<int>(nearest)) - 1), centre));
    }
    const NeighbourSums all = {sumOfWarp(mine.count), sumOfWarp(mine.x),  sumOfWarp(mine.y),  sumOfWarp(mine.z),
                               sumOfWarp(mine.xx),    sumOfWarp(mine.xy), sumOfWarp(mine.xz), sumOfWarp(mine.yy),
                               sumOfWarp(mine.yz),    sumOfWarp(mine.zz)};
    if (lane_ == 0) out = all;
  }

  /// Joins the directions that the point and its nearest neighbours were seen from.
  __device__ void storeSeen(std::uint32_t id, std::uint32_t sharing, DirectionMask& out) const {
    DirectionMask seen = {};
    const auto words = static_cast<std::size_t>(points_.points.direction_words);
#pragma unroll 1
    for (; sharing != 0; sharing &= sharing - 1) {
      const std::uint64_t* const other =
          points_.state.own_seen + idOfListed(__ffs(static_cast<int>(sharing)) - 1) * words;
#pragma unroll
      for (std::size_t w = 0; w < kMaxDirectionWords; ++w) {
        if (w < words) seen.word[w] |= other[w];
      }
    }
#pragma unroll
    for (std::size_t w = 0; w < kMaxDirectionWords; ++w) {
      const std::uint32_t low = __reduce_or_sync(kAllLanes, static_cast<std::uint32_t>(seen.word[w])),
                          high = __reduce_or_sync(kAllLanes, static_cast<std::uint32_t>(seen.word[w] >> 32));
      if (lane_ != 0) continue;
      std::uint64_t all = std::uint64_t{high} << 32 | low;
      if (w < words) all |= points_.state.own_seen[id * words + w];
      out.word[w] = all;
    }
  }

  static constexpr std::int64_t kNone = 0x7fffffffffffffff;

  const PointsView& points_;
  const MovedView& moved_;
  const MovedRange& range_;
  Scratch& s_;
  unsigned warp_;
  int lane_;
  std::uint32_t collected_ = 0;  ///< at most this many are in the batch; the same for all threads
  std::int64_t squared_[kEach];  ///< of this lane's points of the list, or kNone
};

/// Hands out blocks with moved points to one thread of each block of threads. What it hands out was asked for two
/// blocks earlier, so that nobody waits for memory.
class NextBlock {
 public:
  /// @param is_used  whether this thread is the one
  __device__ NextBlock(const MovedView& moved, const MovedRange& range, bool is_used) : moved_(moved), range_(range) {
    if (!is_used) return;
    blocks_ = moved.counters->moved_blocks;
    number_ = takeNumber();
    advance();
  }
  /// @return the part of it in the range, maybe none; first: kNoIndex if there are no more blocks
  [[nodiscard]] __device__ MovedBlock take() {
    MovedBlock taken = {kNoIndex, 0};
    if (is_there_) {
      const std::uint32_t begin = max(block_.first, range_.begin), end = min(block_.first + block_.count, range_.end);
      taken = {begin, begin < end ? end - begin : 0};
    }
    advance();
    return taken;
  }

 private:
  [[nodiscard]] __device__ std::uint32_t takeNumber() const { return atomicAdd(&moved_.counters->next_block, 1u); }
  __device__ void advance() {
    is_there_ = number_ < blocks_;
    if (is_there_) block_ = moved_.blocks[number_];
    number_ = takeNumber();
  }

  const MovedView& moved_;
  const MovedRange& range_;
  std::uint32_t blocks_ = 0, number_ = 0;
  MovedBlock block_;
  bool is_there_ = false;
};

__global__ void __launch_bounds__(kThreads, kBlocksEach)
    neighboursByCell(const __grid_constant__ PointsView points, const __grid_constant__ MovedView moved,
                     const __grid_constant__ MovedRange range) {
  __shared__ Scratch scratch;
  CellSearch search(points, moved, range, scratch);
  NextBlock blocks(moved, range, threadIdx.x == 0);
  if (threadIdx.x == 0) scratch.batch.count = 0;
  while (true) {
    if (threadIdx.x == 0) {
      const MovedBlock next = blocks.take();
      scratch.first = next.first;
      scratch.count = next.count;
    }
    __syncthreads();
    if (scratch.first == kNoIndex) break;
    search.run();
    __syncthreads();  // all have read
  }
  search.finish();
}

}  // namespace

void launchNeighboursByCell(const PointsView& points, const MovedView& moved, const MovedRange& range,
                            int multiprocessors, cudaStream_t stream) {
  if (range.begin == range.end) return;
  static_assert(offsetof(MovedCounters, left) == offsetof(MovedCounters, next_block) + sizeof(std::uint32_t));
  ACCESSVDB_CUDA(cudaMemsetAsync(&moved.counters->next_block, 0, 2 * sizeof(std::uint32_t), stream));
  neighboursByCell<<<static_cast<unsigned>(multiprocessors) * kBlocksEach, kThreads, 0, stream>>>(points, moved, range);
  checkLaunch("neighboursByCell");
}

}  // namespace accessvdb::kernels
