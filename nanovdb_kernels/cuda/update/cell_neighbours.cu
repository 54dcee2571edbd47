// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The neighbourhoods of moved points that have had one before, cell by cell: the points of a cell share the positions
/// around it, which a block of threads gathers once. The same neighbours as in nearest_points.cu, which takes the
/// points for which this does not work out, among them those whose own position cannot be an integer.
#include <cstddef>

#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/near_points.cuh"
#include "cuda/update/nearest_of_list.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = kGatherWarps, kThreads = kGatherThreads;
/// Blocks that a multiprocessor should hold: this limits the registers.
constexpr unsigned kBlocksEach = 7;
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
  NearPoints near;
  std::uint16_t listed[kWarps][NearestOfList::kMostListed];
  Batch batch;
  std::uint16_t order[kMostInBlock];  ///< the block's moved points, cell by cell
  std::uint32_t begin[kCells + 1];
  std::uint32_t first, count;  ///< MovedBlock
};

/// Makes the normals of a batch, one per thread. Not inlined: it is large.
__device__ __noinline__ void makeNormals(const PointsView& points, const MovedView& moved, const MovedRange& range,
                                         Batch& batch) {
  if (threadIdx.x >= batch.count) return;
  const std::uint32_t at = batch.at[threadIdx.x], id = moved.ids[at];
  const float* const to_sensor = points.state.to_sensor_L + 3 * static_cast<std::size_t>(id);
  if (points.state.kept != nullptr && moved.counters->mostlyKnown()) {
    points.state.kept[id].setSums(batch.of[threadIdx.x].sums());
  }
  float normal[3];
  neighbourNormal(batch.of[threadIdx.x].sums(), to_sensor, normal);
  for (int axis = 0; axis < 3; ++axis) range.to[at - range.begin].normal[axis] = normal[axis];
}

/// Makes the neighbourhoods of a block's moved points. All threads of a block share one.
class CellSearch {
 public:
  __device__ CellSearch(const PointsView& points, const MovedView& moved, const MovedRange& range, Scratch& scratch)
      : points_(points),
        moved_(moved),
        range_(range),
        s_(scratch),
        gatherer_(points, scratch.near),
        keeps_(points.state.kept != nullptr && moved.counters->mostlyKnown()),
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
      if (warp_ == 0) {
        gatherer_.makeBox(end - begin, [&](std::uint32_t n) { return idOf(s_.first + s_.order[begin + n]); });
      }
      __syncthreads();
      if (s_.near.fits) gatherer_.gather();
      __syncthreads();
      // The whole cell is left over, or the block divided.
      const bool is_left = !s_.near.areAll();
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

  /// Whether a moved point of the block is still to be searched.
  [[nodiscard]] __device__ bool isLeft(std::uint32_t n) const {
    return !keeps_ || range_.to[s_.first + n - range_.begin].reach_m == MovedRange::kSearched;
  }

  /// Orders the block's moved points by cell, and counts those that are still to be searched.
  __device__ void sortByCell() {
    const std::uint32_t count = s_.count;
    if (threadIdx.x <= kCells) s_.begin[threadIdx.x] = 0;
    __syncthreads();
    const auto cellOf = [&](std::uint32_t n) {
      const float* mean = points_.meanOf(idOf(s_.first + n));
      std::uint32_t cell = 0;
      for (int axis = 0; axis < 3; ++axis) {
        const auto voxel =
            static_cast<std::int32_t>(floor(static_cast<double>(mean[axis]) * points_.rule.inverse_voxel_size + 0.5));
        cell |= static_cast<std::uint32_t>(voxel >> 2 & 1) << axis;
      }
      return cell;
    };
#pragma unroll 1
    for (std::uint32_t n = threadIdx.x; n < count; n += kThreads) {
      if (isLeft(n)) atomicAdd(&s_.begin[cellOf(n)], 1u);
    }
    __syncthreads();
    if (threadIdx.x == 0) {
      std::uint32_t end = 0;
#pragma unroll 1
      for (int cell = 0; cell <= kCells; ++cell) s_.begin[cell] = end += s_.begin[cell];
      s_.count = end;
    }
    __syncthreads();
    // From their ends to their beginnings.
#pragma unroll 1
    for (std::uint32_t n = threadIdx.x; n < count; n += kThreads) {
      if (isLeft(n)) s_.order[atomicSub(&s_.begin[cellOf(n)], 1u) - 1] = static_cast<std::uint16_t>(n);
    }
    __syncthreads();
  }

  /// Finds the neighbours of a moved point with one warp, and stores all of its neighbourhood but the normal.
  /// @return false if the point is left over
  __device__ bool search(std::uint32_t at) {
    const NeighbourRuleView& rule = points_.rule;
    const std::uint32_t id = idOf(at);
    const float* mean = points_.meanOf(id);
    const PositionFractions fractions = s_.near.fractions();
    std::int32_t centre[3];
    bool is_whole = true;
    for (int axis = 0; axis < 3; ++axis) {
      is_whole = is_whole && fractions.areExactAt(mean[axis]);
      centre[axis] = static_cast<std::int32_t>(fractions.of(mean[axis]) - s_.near.origin[axis]);
    }
    if (!is_whole) return false;
    const std::int64_t bound = searchBound(rule, points_.state.reach_m[id]);
    NearestOfList list(s_.near, s_.listed[warp_], lane_);
    const int listed = list.listWithin(centre, bound), wanted = rule.neighbours;
    __syncwarp();  // also if the point is left over: the next one's list is written where this one's was
    if (listed > NearestOfList::kMostListed || (listed < wanted && bound < rule.radius_squared)) return false;
    list.measure(centre, listed);
    NearestOfList::Bound least = {bound, kNoIndex, listed, listed};
    std::uint32_t nearest = 0, sharing = 0;
    // The farthest neighbour is often as far away as the last time (neighbourReach_m).
    const double last_steps = static_cast<double>(points_.state.reach_m[id]) * rule.steps_per_m - 1.9;
    auto guess = static_cast<std::int64_t>(last_steps * last_steps);
#pragma unroll 1
    for (const bool shares : {false, true}) {
      const int count = shares ? rule.view_neighbours : wanted;
      if (least.count > count) {
        least = count > 0 ? list.leastOf(least, count, guess) : NearestOfList::Bound{-1, kNoIndex, 0, listed};
      }
      guess = -1;
      (shares ? sharing : nearest) = list.listedIn(least);
    }
    std::uint32_t place = 0;
    if (lane_ == 0) {
      place = atomicAdd(&s_.batch.count, 1u);
      s_.batch.at[place] = at;
    }
    list.sum(centre, nearest, s_.batch.of[__shfl_sync(kAllLanes, place, 0)].sums());
    FoundNeighbourhood& out = range_.to[at - range_.begin];
    const std::int64_t farthest = listed < wanted ? rule.radius_squared : list.farthestOf(nearest);
    if (lane_ == 0) out.reach_m = neighbourReach_m(farthest, rule.steps_per_m);
    if (points_.state.kept != nullptr) {
      KeptNeighbours& kept = points_.state.kept[id];  // finish() adds the sums
      if (lane_ == 0) kept.farthest = listed < wanted || !keeps_ ? KeptNeighbours::kNone : farthest;
    }
    if (keeps_) {
      const std::int64_t farthest_shared = list.farthestOf(sharing);
      if (lane_ == 0) points_.state.kept[id].farthest_shared = farthest_shared;
    }
    storeSeen(id, list, sharing, out.seen);
    __syncwarp();  // the list is overwritten next
    return true;
  }

  /// Joins the directions that the point and its nearest neighbours were seen from.
  __device__ void storeSeen(std::uint32_t id, const NearestOfList& list, std::uint32_t sharing,
                            DirectionMask& out) const {
    DirectionMask seen = {};
    const auto words = static_cast<std::size_t>(points_.points.direction_words);
#pragma unroll 1
    for (; sharing != 0; sharing &= sharing - 1) {
      const std::uint64_t* const other =
          points_.state.own_seen + list.idOf(__ffs(static_cast<int>(sharing)) - 1) * words;
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

  const PointsView& points_;
  const MovedView& moved_;
  const MovedRange& range_;
  Scratch& s_;
  PointGatherer gatherer_;
  bool keeps_;  ///< whether sums are kept
  unsigned warp_;
  int lane_;
  std::uint32_t collected_ = 0;  ///< at most this many are in the batch; the same for all threads
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
