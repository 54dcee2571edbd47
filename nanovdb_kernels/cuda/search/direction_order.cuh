// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The order of DirectionWalk (hostdev/direction_filter.h), computed by a whole warp.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "hostdev/direction_filter.h"

namespace accessvdb::kernels {

inline constexpr int kMaskWords32 = 2 * kMaxDirectionWords, kMostDirections = 32 * kMaskWords32;

__device__ inline bool testBit(const std::uint32_t* mask, int d) { return (mask[d >> 5] >> (d & 31) & 1u) != 0; }

/// DirectionWalk::nearestDirection, a few directions per lane.
__device__ inline int nearestByWarp(const ApproachView& approach, const float* normal, int lane) {
  int nearest = lane < approach.num_directions ? lane : 0;
  float best = yawCosToNormal(approach, nearest, normal);
#pragma unroll 1
  for (int d = lane + static_cast<int>(kWarp); d < approach.num_directions; d += static_cast<int>(kWarp)) {
    const float c = yawCosToNormal(approach, d, normal);
    if (c > best) {
      best = c;
      nearest = d;
    }
  }
  // Not unrolled for the instruction cache's sake, as SlabCount::upTo() is one loop.
#pragma unroll 1
  for (int step = kWarp / 2; step > 0; step /= 2) {
    const float c = __shfl_xor_sync(kAllLanes, best, step);
    const int d = __shfl_xor_sync(kAllLanes, nearest, step);
    if (c > best || (c == best && d < nearest)) {
      best = c;
      nearest = d;
    }
  }
  return nearest;
}

/// From this cosine on, cosines of neighbouring directions differ by more than rounding (see DirectionWalk).
inline constexpr float kClearCosine = 0.1f;

/// Rank of a direction in the order. The two sides of the nearest direction are each in order, and the walk merges
/// them: the i-th of one side falls between the (i - 1)-th and the (i + 1)-th of the other, so only these are compared.
/// The rank equals the walk's for cosines of at least kClearCosine.
__device__ inline int rankOf(const ApproachView& approach, const float* normal, int nearest, int d, float cosine) {
  const int count = approach.num_directions;
  int up = d - nearest;
  if (up < 0) up += count;
  const int down = count - up;
  const bool is_up = up < down;
  const int i = is_up ? up : down;  // index on its side; the nearest is 0 on the upper side, the lower has no 0
  const int least = is_up ? 1 : 0;  // lowest index on the other side
  int rank = is_up ? i : i - 1;     // number of its own side that come before it
  if (i - 1 > least) rank += i - 1 - least;
#pragma unroll 1
  for (int j = i - 1; j <= i + 1; ++j) {
    if (j < least) continue;
    int other = is_up ? nearest - j : nearest + j;
    if (other < 0) other += count;
    if (other >= count) other -= count;
    if (ranksBefore(yawCosToNormal(approach, other, normal), other, cosine, d)) ++rank;
  }
  return rank;
}

/// Writes the directions in the normal cone in the order of DirectionWalk, one after the other. Not inlined: so wide a
/// cone is rare, and kernels larger than the instruction cache stall on it.
/// @return their number
static __device__ __noinline__ int walkDirections(const float* direction_xy, int num_directions, float normal_cos_min,
                                                  float x, float y, float z, int nearest, std::uint8_t* order,
                                                  int lane) {
  ApproachView approach;
  approach.direction_xy = direction_xy;
  approach.num_directions = num_directions;
  approach.normal_cos_min = normal_cos_min;
  const float normal[3] = {x, y, z};
  DirectionWalk walk(approach, normal, nearest);
  int count = 0;
  for (int d = walk.next(); d >= 0; d = walk.next(), ++count) {
    if (lane == 0) order[count] = static_cast<std::uint8_t>(d);
  }
  return count;
}

/// What sortByRank needs of the warp's shared memory.
struct OrderScratch {
  const std::uint32_t* allowed;  ///< [kMaskWords32]
  std::uint16_t* found;          ///< [kMostDirections] overwritten
  std::uint8_t* order;           ///< [kMostDirections] out
};

/// orderByWarp for directions of any kind, in the order of SortedWalk: a direction's rank is the number of those that
/// come before it. Not inlined, for yaw's sake: see walkDirections.
/// @return the number of directions; bit 31: none is in the cone
static __device__ __noinline__ std::uint32_t sortByRank(const float* axes_xyz, int num_directions, float normal_cos_min,
                                                        float x, float y, float z, OrderScratch scratch, int lane) {
  ApproachView approach;
  approach.axes_xyz = axes_xyz;
  const float normal[3] = {x, y, z};
  int count = 0;
  bool in_cone = false;
#pragma unroll 1
  for (int first = 0; first < num_directions; first += static_cast<int>(kWarp)) {
    const int d = first + lane;
    const bool inside = d < num_directions && cosToNormal(approach, d, normal) >= normal_cos_min;
    in_cone = __any_sync(kAllLanes, inside) != 0 || in_cone;
    const bool wanted = inside && testBit(scratch.allowed, d);
    const unsigned all = __ballot_sync(kAllLanes, wanted);
    if (wanted) scratch.found[count + __popc(all & ((1u << lane) - 1u))] = static_cast<std::uint16_t>(d);
    count += __popc(all);
  }
  __syncwarp();
#pragma unroll 1
  for (int n = lane; n < count; n += static_cast<int>(kWarp)) {
    const int d = scratch.found[n];
    const float cosine = cosToNormal(approach, d, normal);
    int rank = 0;
#pragma unroll 1
    for (int m = 0; m < count; ++m) {
      const int other = scratch.found[m];
      if (ranksBefore(cosToNormal(approach, other, normal), other, cosine, d)) ++rank;
    }
    scratch.order[rank] = static_cast<std::uint8_t>(d);
  }
  __syncwarp();
  return static_cast<std::uint32_t>(count) | (in_cone ? 0u : 1u << 31);
}

/// Writes the `allowed` directions in the normal cone in the order of DirectionWalk or SortedWalk. All lanes call it.
/// @param in_cone  out: whether any direction is in the cone
/// @return their number
__device__ inline int orderByWarp(const ApproachView& approach, const float* normal, const OrderScratch& scratch,
                                  bool& in_cone, int lane) {
  if (approach.axes_xyz != nullptr) {
    const std::uint32_t found = sortByRank(approach.axes_xyz, approach.num_directions, approach.normal_cos_min,
                                           normal[0], normal[1], normal[2], scratch, lane);
    in_cone = found >> 31 == 0;
    return static_cast<int>(found & 0x7fffffffu);
  }
  const std::uint32_t* const allowed = scratch.allowed;
  std::uint8_t* const order = scratch.order;
  const int nearest = nearestByWarp(approach, normal, lane);
  int cone = 0;
  if (approach.normal_cos_min >= kClearCosine) {
#pragma unroll 1
    for (int first = 0; first < approach.num_directions; first += static_cast<int>(kWarp)) {
      const int d = first + lane;
      const float cosine = d < approach.num_directions ? yawCosToNormal(approach, d, normal) : -2.0f;
      const bool inside = cosine >= approach.normal_cos_min;
      if (inside) order[rankOf(approach, normal, nearest, d, cosine)] = static_cast<std::uint8_t>(d);
      cone += __popc(__ballot_sync(kAllLanes, inside));
    }
  } else {
    cone = walkDirections(approach.direction_xy, approach.num_directions, approach.normal_cos_min, normal[0], normal[1],
                          normal[2], nearest, order, lane);
  }
  in_cone = cone > 0;
  __syncwarp();
  int count = 0;
#pragma unroll 1
  for (int first = 0; first < cone; first += static_cast<int>(kWarp)) {
    const int d = first + lane < cone ? order[first + lane] : -1;
    const bool wanted = d >= 0 && testBit(allowed, d);
    const unsigned all = __ballot_sync(kAllLanes, wanted);
    __syncwarp();  // all lanes have read what is overwritten next
    if (wanted) order[count + __popc(all & ((1u << lane) - 1u))] = static_cast<std::uint8_t>(d);
    count += __popc(all);
  }
  __syncwarp();
  return count;
}

}  // namespace accessvdb::kernels
