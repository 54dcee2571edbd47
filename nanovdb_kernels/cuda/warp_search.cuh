// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// searchDirections (hostdev) by the 32 lanes of a warp, with the same result bit for bit.
///
/// Directions come in rank order, as in the plain rule. Lanes test the corridors of up to 32 of them at once; what lies
/// behind the direction that ends the search is thrown away. The tool is then counted one direction at a time, a column
/// or sample a lane; where a count passes its bound, the column at which the plain rule would have stopped is found
/// by a prefix sum, so that even counts that were cut short agree.
#pragma once

#include <cstdint>

#include "cuda/leaf_window.cuh"
#include "hostdev/direction_search.h"

namespace accessvdb::kernels {

inline constexpr unsigned kAllLanes = 0xffffffffu;
inline constexpr int kMaskWords32 = 2 * kMaxDirectionWords;

/// A warp's masks of directions in shared memory, bit d of word d/32.
struct WarpMasks {
  std::uint32_t allowed[kMaskWords32];       ///< seen and candidate
  std::uint32_t skip[kMaskWords32];          ///< known to be blocked
  std::uint32_t arm_blocked[kMaskWords32];   ///< found blocked in the corridor
  std::uint32_t tool_blocked[kMaskWords32];  ///< found blocked by the tool
};

__device__ inline bool testBit(const std::uint32_t* mask, int d) { return (mask[d >> 5] >> (d & 31) & 1u) != 0; }

/// DirectionWalk::nearestDirection, a few directions a lane.
__device__ inline int nearestByWarp(const ApproachView& approach, const float* normal, int lane) {
  int nearest = lane < approach.num_directions ? lane : 0;
  float best = cosToNormal(approach, nearest, normal);
  for (int d = lane + static_cast<int>(kWarp); d < approach.num_directions; d += static_cast<int>(kWarp)) {
    const float c = cosToNormal(approach, d, normal);
    if (c > best) {
      best = c;
      nearest = d;
    }
  }
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

/// The count of the plain rule once 32 more items are counted, an item a lane.
/// @return whether the plain rule stops among them; `count` is then what it stops with
__device__ inline bool addCounts(int& count, int mine, int stop_above, int lane) {
  const int total = __reduce_add_sync(kAllLanes, mine);
  if (count + total <= stop_above) {
    count += total;
    return false;
  }
  int sum = mine;
  for (int step = 1; step < static_cast<int>(kWarp); step *= 2) {
    const int below = __shfl_up_sync(kAllLanes, sum, step);
    if (lane >= step) sum += below;
  }
  const unsigned above = __ballot_sync(kAllLanes, count + sum > stop_above);
  count += __shfl_sync(kAllLanes, sum, __ffs(static_cast<int>(above)) - 1);
  return true;
}

/// countVoxelCollisions. @tparam kTurns  columns a lane has on their way at a time
template <int kTurns, class Window>
__device__ int countVoxelsByWarp(const Window& window, const ToolKernelView& tool, int d, const Coord& point_ijk,
                                 int stop_above, int lane) {
  int count = 0;
  const std::uint32_t end = tool.column_begin[d + 1];
  for (std::uint32_t first = tool.column_begin[d]; first < end; first += kTurns * kWarp) {
    int mine[kTurns], sum = 0;
#pragma unroll
    for (int turn = 0; turn < kTurns; ++turn) {
      const std::uint32_t n = first + static_cast<std::uint32_t>(turn) * kWarp + static_cast<std::uint32_t>(lane);
      mine[turn] = n < end ? window.countColumn(tool.columns[n], point_ijk) : 0;
      sum += mine[turn];
    }
    const int total = __reduce_add_sync(kAllLanes, sum);
    if (count + total <= stop_above) {
      count += total;
      continue;
    }
    // The plain rule stops among these.
#pragma unroll
    for (int turn = 0; turn < kTurns; ++turn) {
      if (addCounts(count, mine[turn], stop_above, lane)) return count;
    }
  }
  return count;
}

/// countSampleCollisions.
template <class Window>
__device__ int countSamplesByWarp(const Window& window, const OccupancyReader& map, const ToolKernelView& tool, int d,
                                  const float* position_L, float inverse_voxel_size, int stop_above, int lane) {
  int count = 0;
  const std::uint32_t end = tool.sample_begin[d + 1];
  for (std::uint32_t first = tool.sample_begin[d]; first < end; first += kWarp) {
    const std::uint32_t n = first + static_cast<std::uint32_t>(lane);
    int mine = 0;
    if (n < end) {
      const float* t = tool.samples + 3 * static_cast<std::int64_t>(n);
      const Coord ijk = voxelOf(position_L[0] + t[0], position_L[1] + t[1], position_L[2] + t[2], inverse_voxel_size);
      mine = (window.holds(ijk) ? window.collides(ijk) : map.collides(ijk)) ? 1 : 0;
    }
    if (addCounts(count, mine, stop_above, lane)) break;
  }
  return count;
}

/// testArm, a direction a lane.
template <class Window>
__device__ ArmResult testArmThrough(const Window& window, const OccupancyReader& map, const ApproachView& approach,
                                    int d, const float* position_L, float inverse_voxel_size) {
  const float* offset = approach.arm_offsets + 3 * static_cast<std::int64_t>(d) * approach.num_arm;
  for (int n = 0; n < approach.num_arm; ++n, offset += 3) {
    const Coord ijk =
        voxelOf(position_L[0] + offset[0], position_L[1] + offset[1], position_L[2] + offset[2], inverse_voxel_size);
    const bool inside = window.holds(ijk);
    if (!(inside ? window.armFree(ijk) : map.armFree(ijk))) {
      const bool collides = inside ? window.collides(ijk) : map.collides(ijk);
      return {n, collides ? PointReason::Arm : PointReason::Unknown};
    }
  }
  return {approach.num_arm, PointReason::None};
}

/// searchDirections. All lanes of the warp call it with the same arguments and get the same result.
/// @param count_further  collisions to count beyond those that decide; changes nothing but masks.tool_blocked
template <class Window>
__device__ ScoreResult searchByWarp(const Window& window, const OccupancyReader& map, float inverse_voxel_size,
                                    const ToolKernelView& tool, const ApproachView& approach, const float* position_L,
                                    const float* normal_L, const std::uint64_t* seen, int seen_words,
                                    const ScoreItem& item, WarpMasks& masks, int lane, int count_further = 0) {
  ScoreResult result;
  if (normal_L[0] == 0 && normal_L[1] == 0 && normal_L[2] == 0) return result;
  result.scored = 1;
  if (lane < kMaskWords32) {
    const int word = lane >> 1, half = (lane & 1) * 32;
    const std::uint64_t seen_word = word < seen_words ? seen[word] : 0;
    masks.allowed[lane] = static_cast<std::uint32_t>((seen_word & item.candidates.word[word]) >> half);
    masks.skip[lane] = static_cast<std::uint32_t>(item.skip.word[word] >> half);
    masks.arm_blocked[lane] = 0;
    masks.tool_blocked[lane] = 0;
  }
  __syncwarp();
  const Coord point_ijk = voxelOf(position_L[0], position_L[1], position_L[2], inverse_voxel_size);
  const int known_score = item.known_score, known_direction = item.known_direction;

  int best_count = kNoScore, best_passed = -1;
  bool in_cone = false, admissible = false, done = false;
  DirectionWalk walk(approach, normal_L, nearestByWarp(approach, normal_L, lane));
  while (!done) {
    // The next admissible directions in rank order, one a lane.
    int mine = -1, count = 0;
    while (count < static_cast<int>(kWarp)) {
      const int d = walk.next();
      if (d < 0) {
        done = true;
        break;
      }
      in_cone = true;
      if (!testBit(masks.allowed, d)) continue;
      if (count == lane) mine = d;
      ++count;
    }
    if (count == 0) break;
    admissible = true;

    const bool is_known = mine >= 0 && mine == known_direction;
    const bool is_skipped = mine >= 0 && !is_known && testBit(masks.skip, mine);
    ArmResult arm = {0, PointReason::None};
    const bool is_tested = mine >= 0 && !is_known && !is_skipped;
    if (is_tested) arm = testArmThrough(window, map, approach, mine, position_L, inverse_voxel_size);
    const bool is_blocked = is_tested && arm.reason != PointReason::None;
    const unsigned known = __ballot_sync(kAllLanes, is_known), skipped = __ballot_sync(kAllLanes, is_skipped),
                   blocked = __ballot_sync(kAllLanes, is_blocked),
                   free = __ballot_sync(kAllLanes, is_tested && !is_blocked);

    // Corridors count as the closest outcome only as long as no direction has reached the tool.
    const unsigned scored = free | (known_score < kNoScore ? known : 0u);
    const unsigned before_scored = scored == 0 ? kAllLanes : (scored & (0u - scored)) - 1;
    if (best_count == kNoScore && (blocked & before_scored) != 0) {
      const bool counts = is_blocked && (before_scored >> lane & 1u) != 0;
      const int most = __reduce_max_sync(kAllLanes, counts ? arm.passed : -1);
      if (most > best_passed) {
        const int first = __ffs(static_cast<int>(__ballot_sync(kAllLanes, counts && arm.passed == most))) - 1;
        best_passed = most;
        result.reason = static_cast<PointReason>(__shfl_sync(kAllLanes, static_cast<int>(arm.reason), first));
        result.direction = static_cast<std::uint16_t>(__shfl_sync(kAllLanes, mine, first));
      }
    }

    unsigned upto = kAllLanes;  // lanes whose directions the plain rule reaches
    for (unsigned events = known | free; events != 0; events &= events - 1) {
      const int at = __ffs(static_cast<int>(events)) - 1;
      const int d = __shfl_sync(kAllLanes, mine, at);
      if ((known >> at & 1u) != 0) {
        if (known_score < best_count) {
          best_count = known_score;
          result.direction = static_cast<std::uint16_t>(d);
        }
      } else {
        const int bound = (best_count < known_score ? best_count : known_score) + count_further;
        const int counted = tool.use_samples
                                ? countSamplesByWarp(window, map, tool, d, position_L, inverse_voxel_size, bound, lane)
                                : countVoxelsByWarp<2>(window, tool, d, point_ijk, bound, lane);
        const int hits = counted < kNoScore ? counted : kNoScore - 1;
        if (hits >= tool.collision_limit) {
          if (lane == 0) masks.tool_blocked[d >> 5] |= 1u << (d & 31);
          if (hits < result.least_blocked) result.least_blocked = static_cast<std::uint16_t>(hits);
        }
        if (hits < best_count) {
          best_count = hits;
          result.direction = static_cast<std::uint16_t>(d);
        }
      }
      if (best_count == 0) {
        done = true;
        upto = (2u << at) - 1;
        break;
      }
    }
    if ((skipped & upto) != 0) result.skipped = 1;
    result.tests = static_cast<std::uint16_t>(result.tests + __popc((blocked | free) & upto));
    if (is_blocked && (upto >> lane & 1u) != 0) atomicOr(&masks.arm_blocked[mine >> 5], 1u << (mine & 31));
  }

  if (!in_cone) {
    result.reason = PointReason::Normal;
  } else if (!admissible) {
    result.reason = PointReason::Unseen;
  } else if (best_count != kNoScore) {
    result.score = static_cast<std::uint16_t>(best_count);
    result.reason = best_count < tool.collision_limit ? PointReason::None : PointReason::Tool;
  }
  __syncwarp();
  return result;  // the masks are in shared memory
}

}  // namespace accessvdb::kernels
