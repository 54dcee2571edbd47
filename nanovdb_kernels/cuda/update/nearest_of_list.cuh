// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The nearest of the points around a cell (near_points.cuh), found by one warp: it lists those within a bound, then
/// narrows down the distance of the k-th.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/near_points.cuh"

namespace accessvdb::kernels {

/// All lanes call each function but idOf().
class NearestOfList {
 public:
  /// Most points listed for one point, and how many of them a lane has.
  static constexpr int kMostListed = 256, kEach = kMostListed / static_cast<int>(kWarp);

  /// @param list  [kMostListed] shared by the warp
  __device__ NearestOfList(const NearPoints& near, std::uint16_t* list, int lane)
      : near_(near), list_(list), lane_(lane) {}

  /// Lists the points up to a squared distance. @return their number, even if not all fit
  [[nodiscard]] __device__ int listWithin(const std::int32_t* centre, std::int64_t bound) const {
    int count = 0;
    const int near = static_cast<int>(near_.count);
    for (int first = 0; first < near; first += static_cast<int>(kWarp)) {
      const int n = first + lane_;
      const bool is_listed = n < near && near_.squaredOf(n, centre) <= bound;
      const unsigned all = __ballot_sync(kAllLanes, is_listed);
      const int place = count + __popc(all & ((1u << lane_) - 1u));
      if (is_listed && place < kMostListed) list_[place] = static_cast<std::uint16_t>(n);
      count += __popc(all);
    }
    return count;
  }
  /// Keeps the squared distances of what was listed.
  __device__ void measure(const std::int32_t* centre, int listed) {
#pragma unroll
    for (int i = 0; i < kEach; ++i) {
      squared_[i] = near_.squaredOf(listedAt(i), centre);
      if (i * static_cast<int>(kWarp) + lane_ >= listed) squared_[i] = kNone;
    }
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
      if (idOf(__ffs(static_cast<int>(ties)) - 1) <= bound.id) inside |= ties & (0u - ties);
    }
    return inside;
  }
  /// Of this lane's i-th point of the list.
  [[nodiscard]] __device__ std::uint32_t idOf(int i) const { return near_.id[listedAt(i)]; }

  /// The `wanted` smallest. @param upper  holds more than `wanted`; some may be equally far away
  /// @param guess  of the bound; negative: none
  __device__ Bound leastOf(const Bound& upper, int wanted, std::int64_t guess) const {
    std::int64_t low = -1, high = upper.squared;  // `wanted` lies between their counts
    int count_low = 0, count_high = upper.count;
#pragma unroll 1
    for (bool halves = false; high - low > 1; halves = !halves) {
      // Counts grow about evenly with the bound, so interpolation comes close; only halving is sure to end.
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

  /// Adds up the offsets of some points of the list.
  __device__ void sum(const std::int32_t* centre, std::uint32_t nearest, NeighbourSums& out) const {
    NeighbourSums mine;
#pragma unroll 1
    for (; nearest != 0; nearest &= nearest - 1) {
      mine.add(near_.offsetOf(listedAt(__ffs(static_cast<int>(nearest)) - 1), centre));
    }
    const NeighbourSums all = {sumOfWarp(mine.count), sumOfWarp(mine.x),  sumOfWarp(mine.y),  sumOfWarp(mine.z),
                               sumOfWarp(mine.xx),    sumOfWarp(mine.xy), sumOfWarp(mine.xz), sumOfWarp(mine.yy),
                               sumOfWarp(mine.yz),    sumOfWarp(mine.zz)};
    if (lane_ == 0) out = all;
  }

 private:
  /// This lane's i-th point of the list; beyond its end, any one.
  [[nodiscard]] __device__ int listedAt(int i) const {
    return min(static_cast<int>(list_[i * static_cast<int>(kWarp) + lane_]), kMostNear - 1);
  }
  /// Of several at exactly this distance, lower ids first. @return the id of the last one
  __device__ std::uint32_t leastIds(std::int64_t squared, int wanted) const {
    std::uint32_t low = 0, high = kNoIndex;
#pragma unroll 1
    while (low < high) {
      const std::uint32_t middle = low + (high - low) / 2;
      unsigned mine = 0;
#pragma unroll
      for (int i = 0; i < kEach; ++i) mine += squared_[i] == squared && idOf(i) <= middle ? 1 : 0;
      if (static_cast<int>(__reduce_add_sync(kAllLanes, mine)) >= wanted) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    return low;
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

  static constexpr std::int64_t kNone = 0x7fffffffffffffff;

  const NearPoints& near_;
  std::uint16_t* list_;
  int lane_;
  std::int64_t squared_[kEach];  ///< of this lane's points of the list, or kNone
};

}  // namespace accessvdb::kernels
