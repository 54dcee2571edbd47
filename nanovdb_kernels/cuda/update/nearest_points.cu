// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The k nearest points of each moved point, one warp per point: exactly, by (squared distance in steps, id).
///
/// The warp lists the points within a bound, which it takes from the last time and adjusts until the list holds k
/// points and fits. Bisection finds the k nearest of them. Their contributions are integer sums, so nothing needs
/// sorting.
#include "cuda/memory/cuda_check.h"
#include "cuda/search/warp.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {
namespace {

constexpr unsigned kWarps = 4;

/// A warp's list of points.
template <unsigned kRoom>
struct NearList {
  std::int64_t squared[kRoom];
  std::uint32_t id[kRoom];
};

/// Bounds the m smallest of a list by (squared, id): squared < bound.squared, or equal and id <= bound.id.
struct NearBound {
  std::int64_t squared;
  std::uint32_t id;
  __device__ bool holds(std::int64_t s, std::uint32_t i) const { return s < squared || (s == squared && i <= id); }
};

template <unsigned kRoom>
class NearSearch {
 public:
  __device__ NearSearch(const PointsView& points, std::uint32_t id, NearList<kRoom>& list, unsigned lane)
      : points_(points), list_(list), lane_(lane), centre_(points.meanOf(id)) {}

  /// Lists all points up to a squared distance. @return their number, even if not all fit
  __device__ unsigned list(std::int64_t bound) const {
    const NeighbourRuleView& rule = points_.rule;
    const double reach_voxels =
        (sqrt(static_cast<double>(bound)) + 1) / rule.steps_per_m * rule.inverse_voxel_size + kMeanRoundingVoxels;
    int low[3], side[3];
    double centre[3];  // [voxels]; leaf l holds [8 l - 1/2, 8 l + 7 1/2)
    for (int axis = 0; axis < 3; ++axis) {
      centre[axis] = static_cast<double>(centre_[axis]) * rule.inverse_voxel_size + 0.5;
      low[axis] = static_cast<int>(floor((centre[axis] - reach_voxels) / 8));
      side[axis] = static_cast<int>(floor((centre[axis] + reach_voxels) / 8)) - low[axis] + 1;
    }
    const int all = side[0] * side[1] * side[2];
    unsigned count = 0;
    for (int base = 0; base < all; base += static_cast<int>(kWarp)) {
      const int n = base + static_cast<int>(lane_);
      std::uint32_t first = 0, points = 0;
      if (n < all) {
        const int leaf[3] = {low[0] + n / (side[1] * side[2]), low[1] + n / side[2] % side[1], low[2] + n % side[2]};
        double squared = 0;
        for (int axis = 0; axis < 3; ++axis) {
          const double below = leaf[axis] * 8.0 - centre[axis], above = centre[axis] - (leaf[axis] * 8.0 + 8);
          const double gap = below > 0 ? below : above > 0 ? above : 0;
          squared += gap * gap;
        }
        if (squared <= reach_voxels * reach_voxels) {
          const std::uint32_t block = points_.index.find(leaf[0], leaf[1], leaf[2]);
          if (block != kNoIndex) {
            first = points_.index.first[block];
            points = points_.index.count[block];
          }
        }
      }
      for (unsigned found = __ballot_sync(kAllLanes, points > 0); found != 0; found &= found - 1) {
        const int from = __ffs(static_cast<int>(found)) - 1;
        const std::uint32_t begin = __shfl_sync(kAllLanes, first, from), size = __shfl_sync(kAllLanes, points, from);
        for (std::uint32_t i = 0; i < size; i += kWarp) {
          std::uint32_t id = 0;
          std::int64_t squared = bound + 1;
          if (i + lane_ < size) {
            id = points_.index.ids[begin + i + lane_];
            squared = offsetOf(id).squared();
          }
          const unsigned near = __ballot_sync(kAllLanes, squared <= bound);
          const unsigned at = count + static_cast<unsigned>(__popc(near & ((1u << lane_) - 1)));
          if (squared <= bound && at < kRoom) {
            list_.squared[at] = squared;
            list_.id[at] = id;
          }
          count += static_cast<unsigned>(__popc(near));
        }
      }
    }
    __syncwarp();
    return count;
  }

  /// @param count  length of the list, at least `wanted`  @param most  largest possible squared distance
  __device__ NearBound least(unsigned count, unsigned wanted, std::int64_t most) const {
    std::int64_t low = 0, high = most;
    while (low < high) {
      const std::int64_t middle = (low + high) >> 1;
      unsigned mine = 0;
      for (unsigned n = lane_; n < count; n += kWarp) mine += list_.squared[n] <= middle ? 1 : 0;
      const unsigned total = __reduce_add_sync(kAllLanes, mine);
      if (total == wanted) return {middle, kNoIndex};
      if (total > wanted) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    // Several at exactly this distance: lower ids first.
    unsigned mine = 0;
    for (unsigned n = lane_; n < count; n += kWarp) mine += list_.squared[n] < low ? 1 : 0;
    const unsigned nearer = __reduce_add_sync(kAllLanes, mine);
    std::uint32_t low_id = 0, high_id = kNoIndex;
    while (low_id < high_id) {
      const std::uint32_t middle = low_id + (high_id - low_id) / 2;
      mine = 0;
      for (unsigned n = lane_; n < count; n += kWarp) mine += list_.squared[n] == low && list_.id[n] <= middle ? 1 : 0;
      if (nearer + __reduce_add_sync(kAllLanes, mine) >= wanted) {
        high_id = middle;
      } else {
        low_id = middle + 1;
      }
    }
    return {low, low_id};
  }

  __device__ NeighbourOffset offsetOf(std::uint32_t id) const {
    return neighbourOffset(centre_, points_.meanOf(id), points_.rule.steps_per_m);
  }

 private:
  const PointsView& points_;
  NearList<kRoom>& list_;
  unsigned lane_;
  const float* centre_;
};

__device__ std::int64_t sumOfWarp(std::int64_t value) {
  for (int step = kWarp / 2; step > 0; step /= 2) value += __shfl_xor_sync(kAllLanes, value, step);
  return value;
}

__device__ std::int64_t squareOf(double steps) {
  const auto whole = static_cast<std::int64_t>(steps);
  return whole * whole;
}

/// Finds the nearest points of one point with a warp. All lanes call it and get the same.
/// @param guess  [steps] radius to begin with if it never had a neighbourhood  @param failed  as for launchNearest
template <unsigned kRoom>
__device__ FoundNeighbours findNearest(const PointsView& points, std::uint32_t id, double guess, NearList<kRoom>& list,
                                       std::uint32_t* failed) {
  const unsigned lane = threadIdx.x % kWarp;
  const NeighbourRuleView& rule = points.rule;
  const NearSearch<kRoom> search(points, id, list, lane);
  const auto wanted = static_cast<unsigned>(rule.neighbours);

  const float reach_m = points.state.reach_m[id];
  std::int64_t bound = reach_m >= 0 ? squareOf(neighbourSearchSteps(reach_m, rule.steps_per_m)) : squareOf(guess);
  if (bound > rule.radius_squared) bound = rule.radius_squared;
  std::int64_t too_small = -1, too_large = -1;
  unsigned listed = 0;
  while (true) {
    listed = search.list(bound);
    if (listed > kRoom) {
      too_large = bound;
      bound = too_small >= 0 ? too_small + (too_large - too_small) / 2
                             : static_cast<std::int64_t>(static_cast<double>(bound) * 0.8 * kRoom / listed);
    } else if (listed >= wanted || bound == rule.radius_squared) {
      break;
    } else {
      too_small = bound;
      if (too_large >= 0) {
        bound = too_small + (too_large - too_small) / 2;
      } else {
        // On a surface the number of points grows with the squared distance.
        double factor = 1.3 * wanted / (listed + 1);
        factor = factor < 1.3 ? 1.3 : factor > 4 ? 4 : factor;
        bound = static_cast<std::int64_t>(static_cast<double>(bound + 1) * factor);
        if (bound > rule.radius_squared) bound = rule.radius_squared;
      }
    }
    if (too_large >= 0 && too_large - too_small <= 1) {
      // More points at a single distance than the list holds. Positions on a voxel grid have some hundred neighbours at
      // one distance, fewer than there is room for.
      if (lane == 0) atomicExch(failed, 1u);
      return {};
    }
  }

  NearBound nearest = {bound, kNoIndex}, sharing = nearest;
  std::int64_t farthest = rule.radius_squared;
  if (listed >= wanted) nearest = search.least(listed, wanted, bound);
  const auto view_wanted = static_cast<unsigned>(rule.view_neighbours);
  if (listed > view_wanted) sharing = view_wanted > 0 ? search.least(listed, view_wanted, bound) : NearBound{-1, 0};

  NeighbourSums sums;
  DirectionMask seen = {};
  std::int64_t most = 0;
  const auto words = static_cast<std::size_t>(points.points.direction_words);
  for (unsigned n = lane; n < listed; n += kWarp) {
    const std::int64_t squared = list.squared[n];
    const std::uint32_t other = list.id[n];
    if (!nearest.holds(squared, other)) continue;
    sums.add(search.offsetOf(other));
    if (squared > most) most = squared;
    if (!sharing.holds(squared, other)) continue;
    for (std::size_t w = 0; w < words; ++w) seen.word[w] |= points.state.own_seen[other * words + w];
  }
  std::int64_t* const parts[] = {&sums.count, &sums.x,  &sums.y,  &sums.z,  &sums.xx,
                                 &sums.xy,    &sums.xz, &sums.yy, &sums.yz, &sums.zz};
  for (std::int64_t* part : parts) *part = sumOfWarp(*part);
  for (int step = kWarp / 2; step > 0; step /= 2) {
    const std::int64_t other = __shfl_xor_sync(kAllLanes, most, step);
    if (other > most) most = other;
  }
  if (listed >= wanted) farthest = most;
  for (std::size_t w = 0; w < words; ++w) {
    const auto low = __reduce_or_sync(kAllLanes, static_cast<unsigned>(seen.word[w]));
    const auto high = __reduce_or_sync(kAllLanes, static_cast<unsigned>(seen.word[w] >> 32));
    seen.word[w] = static_cast<std::uint64_t>(high) << 32 | low | points.state.own_seen[id * words + w];
  }
  return {sums, farthest, seen};
}

/// One warp per point.
template <unsigned kRoom>
__global__ void __launch_bounds__(kWarps* kWarp)
    nearestPoints(PointsView points, PointChunk part, double guess, std::uint32_t* failed, FoundNeighbours* found) {
  extern __shared__ std::int64_t shared[];
  const unsigned warp = threadIdx.x / kWarp, lane = threadIdx.x % kWarp;
  auto& list = reinterpret_cast<NearList<kRoom>*>(shared)[warp];
  const std::uint32_t at = blockIdx.x * (blockDim.x / kWarp) + warp;
  if (!part.holds(at)) return;
  const FoundNeighbours all = findNearest(points, part.ids[part.first + at], guess, list, failed);
  if (lane == 0) found[at] = all;
}

__device__ void makeNeighbourhood(const PointsView& points, std::uint32_t id, const FoundNeighbours& found,
                                  FoundNeighbourhood& out) {
  neighbourNormal(found.sums, points.state.to_sensor_L + 3 * static_cast<std::size_t>(id), out.normal);
  out.reach_m = neighbourReach_m(found.farthest, points.rule.steps_per_m);
  out.seen = found.seen;
  if (points.state.kept != nullptr) points.state.kept[id].farthest = KeptNeighbours::kNone;
}

/// One warp per point, as many as run at a time: few are left.
template <unsigned kRoom>
__global__ void __launch_bounds__(kWarps* kWarp) nearestOfLeft(PointsView points, MovedView moved, MovedRange range) {
  extern __shared__ std::int64_t shared[];
  const unsigned warp = threadIdx.x / kWarp, warps = blockDim.x / kWarp;
  auto& list = reinterpret_cast<NearList<kRoom>*>(shared)[warp];
  const std::uint32_t left = moved.counters->left;
  for (std::uint32_t n = blockIdx.x * warps + warp; n < left; n += gridDim.x * warps) {
    const std::uint32_t at = range.left[n], id = moved.ids[at];
    const FoundNeighbours found = findNearest(points, id, 0, list, &moved.counters->failed);
    if (threadIdx.x % kWarp == 0) makeNeighbourhood(points, id, found, range.to[at - range.begin]);
    __syncwarp();  // the list is overwritten next
  }
}

/// One thread per point, for serial work that a warp cannot share.
__global__ void makeNeighbourhoods(PointsView points, PointChunk part, const FoundNeighbours* found,
                                   FoundNeighbourhood* neighbourhoods) {
  const std::uint32_t n = blockIdx.x * blockDim.x + threadIdx.x;
  if (!part.holds(n)) return;
  makeNeighbourhood(points, part.ids[part.first + n], found[n], neighbourhoods[n]);
}

__global__ void notePrepared(MovedCounters* counters, std::uint32_t most) {
  counters->prepared = counters->moved < most ? counters->moved : most;
}

template <unsigned kRoom>
void launch(const PointsView& points, const PointChunk& part, unsigned warps, std::uint32_t* failed,
            FoundNeighbours* found, cudaStream_t stream) {
  const std::size_t bytes = warps * sizeof(NearList<kRoom>);
  // The same guess as on the CPU: half of k voxels on a surface.
  const double guess =
      sqrt(0.5 * points.rule.neighbours) * static_cast<double>(points.rule.voxel_size_m) * points.rule.steps_per_m;
  nearestPoints<kRoom>
      <<<(part.count + warps - 1) / warps, warps * kWarp, bytes, stream>>>(points, part, guess, failed, found);
  checkLaunch("nearestPoints");
}

/// Whether a short list is enough.
bool isShort(const NeighbourRuleView& rule) {
  // Room for twice k and some more, within the 48 KB that every device has. Positions on a voxel grid may have many
  // neighbours at one distance, more with a larger radius.
  constexpr std::int64_t kFewAtOneDistance = 50;  // voxels
  const double radius_voxels =
      sqrt(static_cast<double>(rule.radius_squared)) / rule.steps_per_m * rule.inverse_voxel_size;
  return rule.neighbours <= 120 && radius_voxels <= static_cast<double>(kFewAtOneDistance);
}

template <unsigned kRoom, unsigned kWarpsEach>
void launchOfLeft(const PointsView& points, const MovedView& moved, const MovedRange& range, unsigned blocks,
                  cudaStream_t stream) {
  nearestOfLeft<kRoom>
      <<<blocks, kWarpsEach * kWarp, kWarpsEach * sizeof(NearList<kRoom>), stream>>>(points, moved, range);
  checkLaunch("nearestOfLeft");
}

}  // namespace

void launchNearest(const PointsView& points, const PointChunk& part, std::uint32_t* failed, FoundNeighbours* found,
                   cudaStream_t stream) {
  if (part.count == 0) return;
  if (isShort(points.rule)) {
    launch<384>(points, part, kWarps, failed, found, stream);
  } else {
    launch<1536>(points, part, 2, failed, found, stream);
  }
}

void launchNearestOfLeft(const PointsView& points, const MovedView& moved, const MovedRange& range, int multiprocessors,
                         cudaStream_t stream) {
  if (range.begin == range.end) return;
  constexpr unsigned kBlocksEach = 8;
  const unsigned blocks = static_cast<unsigned>(multiprocessors) * kBlocksEach;
  if (isShort(points.rule)) {
    launchOfLeft<384, kWarps>(points, moved, range, blocks, stream);
  } else {
    launchOfLeft<1536, 2>(points, moved, range, blocks, stream);
  }
}

void launchMakeNeighbourhoods(const PointsView& points, const PointChunk& part, const FoundNeighbours* found,
                              FoundNeighbourhood* neighbourhoods, cudaStream_t stream) {
  if (part.count == 0) return;
  constexpr unsigned kThreads = 256;
  makeNeighbourhoods<<<(part.count + kThreads - 1) / kThreads, kThreads, 0, stream>>>(points, part, found,
                                                                                      neighbourhoods);
  checkLaunch("makeNeighbourhoods");
}

void launchNotePrepared(MovedCounters* counters, std::uint32_t most, cudaStream_t stream) {
  notePrepared<<<1, 1, 0, stream>>>(counters, most);
  checkLaunch("notePrepared");
}

}  // namespace accessvdb::kernels
