// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points around a cell, which a block of threads gathers into shared memory. Their positions are integers, from
/// the corner of the box around the cell (hostdev/near_positions.h).
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/update_views.cuh"
#include "hostdev/near_positions.h"
#include "hostdev/neighbour_rule.h"

namespace accessvdb::kernels {

/// Warps that gather points together.
inline constexpr unsigned kGatherWarps = 4, kGatherThreads = kGatherWarps * kWarp;
/// Most points around a cell.
inline constexpr int kMostNear = 1024;

/// Largest squared distance that is searched. @param reach_m  of the last time
__device__ inline std::int64_t searchBound(const NeighbourRuleView& rule, float reach_m) {
  const auto steps = static_cast<std::int64_t>(neighbourSearchSteps(reach_m, rule.steps_per_m));
  return min(steps * steps, rule.radius_squared);
}

/// In shared memory, which has no constructors.
struct NearPoints {
  std::int32_t position[3][kMostNear];  ///< from the corner of the box
  std::uint32_t id[kMostNear];
  std::uint32_t count;  ///< also of those that do not fit
  // The box around the cell.
  long long origin[3];
  std::uint32_t width[3];
  std::int32_t leaf_low[3], leaf_side[3];
  double per_metre;  ///< PositionFractions
  int bits;
  bool fits;              ///< whether positions around the cell do
  std::uint32_t inexact;  ///< not 0: a point without exact offsets is around it

  /// Whether all points around the cell are there.
  [[nodiscard]] __device__ bool areAll() const { return fits && inexact == 0 && count <= kMostNear; }
  [[nodiscard]] __device__ PositionFractions fractions() const { return {bits, per_metre}; }
  /// The offset of the n-th point from a centre.
  [[nodiscard]] __device__ NeighbourOffset offsetOf(int n, const std::int32_t* centre) const {
    const auto steps = [&](int axis) { return fractions().offset(centre[axis], position[axis][n]); };
    return {steps(0), steps(1), steps(2)};
  }
  [[nodiscard]] __device__ std::int64_t squaredOf(int n, const std::int32_t* centre) const {
    return offsetOf(n, centre).squared();
  }
};

/// Orders like the floats.
__device__ inline std::int32_t orderedBits(float value) {
  const std::int32_t bits = __float_as_int(value);
  return bits ^ ((bits >> 31) & 0x7fffffff);
}
__device__ inline float fromOrderedBits(std::int32_t bits) {
  return __int_as_float(bits ^ ((bits >> 31) & 0x7fffffff));
}

/// Fills NearPoints. All threads of a block share one.
class PointGatherer {
 public:
  __device__ PointGatherer(const PointsView& points, NearPoints& near)
      : points_(points), near_(near), warp_(threadIdx.x / kWarp), lane_(static_cast<int>(threadIdx.x % kWarp)) {}

  /// Makes the box that holds all points in question for some points. One warp calls it.
  /// @param idOf  of the n-th of `count` points
  template <class IdOf>
  __device__ void makeBox(std::uint32_t count, const IdOf& idOf) {
    constexpr std::int32_t kMost = 0x7fffffff;
    std::int32_t low[3] = {kMost, kMost, kMost}, high[3] = {-kMost, -kMost, -kMost}, reach = 0;
#pragma unroll 1
    for (std::uint32_t n = static_cast<std::uint32_t>(lane_); n < count; n += kWarp) {
      const std::uint32_t id = idOf(n);
      const float* mean = points_.meanOf(id);
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = min(low[axis], orderedBits(mean[axis]));
        high[axis] = max(high[axis], orderedBits(mean[axis]));
      }
      reach = max(reach, __float_as_int(points_.state.reach_m[id]));  // not negative
    }
    reach = __reduce_max_sync(kAllLanes, reach);
    const double reach_steps = sqrt(static_cast<double>(searchBound(points_.rule, __int_as_float(reach)))) + 2;
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
      near_.count = 0;
      near_.fits = fractions.bits > 0;
      near_.inexact = 0;
      near_.bits = fractions.bits;
      near_.per_metre = fractions.per_metre;
    }
    if (lane_ < 3) {
      const long long origin = __double2ll_rd(my_low * per_step);
      near_.origin[lane_] = origin;
      near_.width[lane_] = static_cast<std::uint32_t>(__double2ll_ru(my_high * per_step) - origin);
      // In voxels, of which leaf l holds [8 l - 1/2, 8 l + 7 1/2).
      const double voxels_per_step = points_.rule.inverse_voxel_size / points_.rule.steps_per_m;
      const auto leafAt = [&](double steps, double rounding) {
        return static_cast<std::int32_t>(floor((steps * voxels_per_step + 0.5 + rounding) / 8));
      };
      near_.leaf_low[lane_] = leafAt(my_low, -kMeanRoundingVoxels);
      near_.leaf_side[lane_] = leafAt(my_high, kMeanRoundingVoxels) - near_.leaf_low[lane_] + 1;
    }
  }

  /// Gathers the points in the box. All threads call it.
  __device__ void gather() {
    const std::int32_t* const side = near_.leaf_side;
    const int all = side[0] * side[1] * side[2];
    // Neighbouring leaves go to different warps, which share the work that way.
#pragma unroll 1
    for (int base = 0; base < all; base += static_cast<int>(kGatherThreads)) {
      const int n = base + lane_ * static_cast<int>(kGatherWarps) + static_cast<int>(warp_);
      std::uint32_t first = 0, count = 0;
      if (n < all) {
        const std::uint32_t block =
            points_.index.find(near_.leaf_low[0] + n / (side[1] * side[2]), near_.leaf_low[1] + n / side[2] % side[1],
                               near_.leaf_low[2] + n % side[2]);
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

 private:
  /// One point per lane.
  __device__ void gatherOne(std::uint32_t first, bool is_there) {
    std::uint32_t id = 0;
    std::int32_t at[3] = {0, 0, 0};
    if (is_there) {
      id = points_.index.ids[first + static_cast<std::uint32_t>(lane_)];
      const float* mean = points_.meanOf(id);
      for (int axis = 0; axis < 3; ++axis) {
        if (!hasExactOffsets(mean[axis])) atomicOr(&near_.inexact, 1u);
        const std::int64_t from = near_.fractions().of(mean[axis]) - near_.origin[axis];
        is_there = is_there && static_cast<unsigned long long>(from) <= near_.width[axis];
        at[axis] = static_cast<std::int32_t>(from);
      }
    }
    const unsigned all = __ballot_sync(kAllLanes, is_there);
    if (all == 0) return;
    std::uint32_t place = 0;
    if (lane_ == 0) place = atomicAdd(&near_.count, static_cast<std::uint32_t>(__popc(all)));
    place = __shfl_sync(kAllLanes, place, 0) + static_cast<std::uint32_t>(__popc(all & ((1u << lane_) - 1u)));
    if (!is_there || place >= kMostNear) return;
    for (int axis = 0; axis < 3; ++axis) near_.position[axis][place] = at[axis];
    near_.id[place] = id;
  }

  const PointsView& points_;
  NearPoints& near_;
  unsigned warp_;
  int lane_;
};

}  // namespace accessvdb::kernels
