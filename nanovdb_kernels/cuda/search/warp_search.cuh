// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// searchDirections (hostdev) by the 32 lanes of a warp, with the same result bit for bit.
///
/// Directions come in rank order, as in the plain rule. Lanes test the corridors of up to 32 of them at once; what lies
/// behind the direction that ends the search is thrown away. The tool is then counted one direction at a time, by all
/// lanes: slab by slab (slab_count.cuh), or a column or sample a lane.
#pragma once

#include <cstdint>

#include "cuda/search/direction_order.cuh"
#include "cuda/search/leaf_window.cuh"
#include "cuda/search/slab_count.cuh"
#include "hostdev/direction_search.h"

namespace accessvdb::kernels {

/// What a warp keeps in shared memory while it searches; masks have bit d of word d/32.
struct WarpMasks {
  std::uint32_t allowed[kMaskWords32];       ///< seen and candidate
  std::uint32_t skip[kMaskWords32];          ///< known to be blocked
  std::uint32_t arm_blocked[kMaskWords32];   ///< found blocked in the corridor
  std::uint32_t tool_blocked[kMaskWords32];  ///< found blocked by the tool
  std::uint32_t put_off[kMaskWords32];       ///< blocked for certain, but not counted yet
  std::uint32_t counted[kMaskWords32];       ///< in which the tool was looked at
  std::uint16_t least[kMostDirections];      ///< collisions of those two at least
  std::uint8_t order[kMostDirections];       ///< the allowed ones in rank order
};

/// Where nothing is known of collisions.
struct NothingKnown {
  __device__ int operator()(int) const { return 0; }
};

/// The count of the plain rule once 32 more items are counted, an item a lane.
/// @return whether the plain rule stops among them; `count` is then what it stops with
__device__ inline bool addCounts(int& count, int mine, int stop_above, int lane) {
  const int total = __reduce_add_sync(kAllLanes, mine);
  if (count + total <= stop_above) {
    count += total;
    return false;
  }
  const int sum = sumUpTo(mine, lane);
  const unsigned above = __ballot_sync(kAllLanes, count + sum > stop_above);
  count += __shfl_sync(kAllLanes, sum, __ffs(static_cast<int>(above)) - 1);
  return true;
}

/// Colliding voxels of some columns of the tool, with what the plain rule would stop with.
/// @tparam kTurns  columns a lane has on their way at a time
template <int kTurns, class Window>
__device__ int countColumnsByWarp(const Window& window, const VoxelColumn* columns, std::uint32_t begin,
                                  std::uint32_t end, const Coord& point_ijk, int stop_above, int lane) {
  int count = 0;
  for (std::uint32_t first = begin; first < end; first += kTurns * kWarp) {
    int mine[kTurns], sum = 0;
#pragma unroll
    for (int turn = 0; turn < kTurns; ++turn) {
      const std::uint32_t n = first + static_cast<std::uint32_t>(turn) * kWarp + static_cast<std::uint32_t>(lane);
      mine[turn] = n < end ? window.countColumn(columns[n], point_ijk) : 0;
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

/// countVoxelCollisions.
template <int kTurns, class Window>
__device__ int countVoxelsByWarp(const Window& window, const ToolKernelView& tool, int d, const Coord& point_ijk,
                                 int stop_above, int lane) {
  return countColumnsByWarp<kTurns>(window, tool.columns, tool.column_begin[d], tool.column_begin[d + 1], point_ijk,
                                    stop_above, lane);
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
#pragma unroll 1
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

// How a search counts. What it gets is exact up to `stop_above`; beyond, a counter that is `kPlain` gives the number at
// which the plain rule stops, another one some number above it that the collisions reach.

/// A column of voxels a lane.
template <class Window>
struct ColumnCounter {
  static constexpr bool kPlain = true;
  const Window& window;
  const ToolKernelView& tool;
  const Coord& point_ijk;
  int lane;

  __device__ int operator()(int d, int stop_above) const {
    return countVoxelsByWarp<2>(window, tool, d, point_ijk, stop_above, lane);
  }
};
/// A sample a lane.
template <class Window>
struct SampleCounter {
  static constexpr bool kPlain = true;
  const Window& window;
  const OccupancyReader& map;
  const ToolKernelView& tool;
  const float* position_L;
  float inverse_voxel_size;
  int lane;

  __device__ int operator()(int d, int stop_above) const {
    return countSamplesByWarp(window, map, tool, d, position_L, inverse_voxel_size, stop_above, lane);
  }
};
/// Slab by slab. @tparam kThick  as SlabCount's
template <bool kThick>
struct SlabCounter {
  static constexpr bool kPlain = false;
  SlabWork& work;  ///< of the point
  int lane;

  __device__ int operator()(int d, int stop_above) const { return countSlabs<kThick>(work, d, stop_above, lane); }
};

/// kNoScore means: no direction got this far.
__device__ inline int belowNoScore(int count) { return count < kNoScore ? count : kNoScore - 1; }

/// The direction that was put off with the least collisions, and takes it off the list. All lanes.
/// @return -1 where there is none with at most `most`
__device__ inline int takePutOff(WarpMasks& masks, int most, int lane) {
  std::uint32_t least = 0xffffffffu;
#pragma unroll 1
  for (int w = 0; w < kMaskWords32; ++w) {
    const int d = 32 * w + lane;
    if (!testBit(masks.put_off, d)) continue;
    const std::uint32_t mine = static_cast<std::uint32_t>(masks.least[d]) << 8 | static_cast<std::uint32_t>(d);
    if (mine < least) least = mine;
  }
  least = __reduce_min_sync(kAllLanes, least);
  if (least == 0xffffffffu || static_cast<int>(least >> 8) > most) return -1;
  const int d = static_cast<int>(least & 0xffu);
  __syncwarp();  // all have read
  if (lane == 0) masks.put_off[d >> 5] &= ~(1u << (d & 31));
  __syncwarp();
  return d;
}

/// searchDirections. All lanes of the warp call it with the same arguments and get the same result.
/// @param known_collisions  of a direction: a number of collisions that it reaches; asked only where the counter is not
/// plain
/// @param remember_at  up to which collisions are counted where that is cheap, for masks.least
template <class Window, class Counter, class Known = NothingKnown>
__device__ ScoreResult searchByWarp(const Window& window, const OccupancyReader& map, float inverse_voxel_size,
                                    const Counter& counter, int limit, const ApproachView& approach,
                                    const float* position_L, const float* normal_L, const std::uint64_t* seen,
                                    int seen_words, const ScoreItem& item, WarpMasks& masks, int lane,
                                    const Known& known_collisions = {}, int remember_at = 0) {
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
    masks.put_off[lane] = 0;
    masks.counted[lane] = 0;
  }
  __syncwarp();
  const int known_score = item.known_score, known_direction = item.known_direction;

  int best_count = kNoScore, best_passed = -1;
  bool in_cone = false, tool_reached = false, some_put_off = false;
  const auto note = [&](int d, int hits) {
    if (hits >= limit && hits < result.least_blocked) result.least_blocked = static_cast<std::uint16_t>(hits);
    if (lane != 0) return;
    if (hits >= limit) masks.tool_blocked[d >> 5] |= 1u << (d & 31);
    masks.counted[d >> 5] |= 1u << (d & 31);
    masks.least[d] = static_cast<std::uint16_t>(hits);
  };
  const int count = orderByWarp(approach, normal_L, masks.allowed, masks.order, in_cone, lane);
  bool done = false;
  // The next directions in rank order, one a lane.
#pragma unroll 1
  for (int first = 0; first < count && !done; first += static_cast<int>(kWarp)) {
    const int mine = first + lane < count ? masks.order[first + lane] : -1;
    const bool is_known = mine >= 0 && mine == known_direction;
    const bool is_skipped = mine >= 0 && !is_known && testBit(masks.skip, mine);
    ArmResult arm = {0, PointReason::None};
    const bool is_tested = mine >= 0 && !is_known && !is_skipped;
    if (is_tested) arm = testArmThrough(window, map, approach, mine, position_L, inverse_voxel_size);
    const bool is_blocked = is_tested && arm.reason != PointReason::None;
    const int my_least = !Counter::kPlain && is_tested && !is_blocked ? known_collisions(mine) : 0;
    const unsigned known = __ballot_sync(kAllLanes, is_known), skipped = __ballot_sync(kAllLanes, is_skipped),
                   blocked = __ballot_sync(kAllLanes, is_blocked),
                   free = __ballot_sync(kAllLanes, is_tested && !is_blocked);

    // Corridors count as the closest outcome only as long as no direction has reached the tool.
    const unsigned scored = free | (known_score < kNoScore ? known : 0u);
    const unsigned before_scored = scored == 0 ? kAllLanes : (scored & (0u - scored)) - 1;
    if (!tool_reached && (blocked & before_scored) != 0) {
      const bool counts = is_blocked && (before_scored >> lane & 1u) != 0;
      const int most = __reduce_max_sync(kAllLanes, counts ? arm.passed : -1);
      if (most > best_passed) {
        const int closest = __ffs(static_cast<int>(__ballot_sync(kAllLanes, counts && arm.passed == most))) - 1;
        best_passed = most;
        result.reason = static_cast<PointReason>(__shfl_sync(kAllLanes, static_cast<int>(arm.reason), closest));
        result.direction = static_cast<std::uint16_t>(__shfl_sync(kAllLanes, mine, closest));
      }
    }
    tool_reached = tool_reached || scored != 0;

    unsigned upto = kAllLanes;  // lanes whose directions the plain rule reaches
#pragma unroll 1
    for (unsigned events = known | free; events != 0; events &= events - 1) {
      const int at = __ffs(static_cast<int>(events)) - 1;
      const int d = __shfl_sync(kAllLanes, mine, at);
      if ((known >> at & 1u) != 0) {
        if (known_score < best_count) {
          best_count = known_score;
          result.direction = static_cast<std::uint16_t>(d);
        }
      } else {
        const int bound = best_count < known_score ? best_count : known_score;
        int hits = 0;
        if constexpr (!Counter::kPlain) {
          // As long as there is no count: where it is blocked for certain, a free direction would make its count
          // needless, and without one the least of them comes first.
          const int enough = bound == kNoScore ? limit - 1 : bound;
          hits = __shfl_sync(kAllLanes, my_least, at);
          if (hits <= enough) {
            const int stop_above = remember_at > enough ? remember_at - 1 : enough;
            hits = belowNoScore(counter(d, stop_above));
            note(d, hits);
          }
          if (hits > enough && bound == kNoScore) {
            some_put_off = true;
            if (lane == 0) {
              masks.put_off[d >> 5] |= 1u << (d & 31);
              masks.least[d] = static_cast<std::uint16_t>(hits);
            }
            __syncwarp();
            continue;
          }
        } else {
          hits = belowNoScore(counter(d, bound));
          note(d, hits);
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

  if (!Counter::kPlain && some_put_off && best_count >= limit) {
#pragma unroll 1
    for (int d = takePutOff(masks, best_count, lane); d >= 0; d = takePutOff(masks, best_count, lane)) {
      const int hits = belowNoScore(counter(d, best_count));
      const int before = masks.least[d];
      __syncwarp();  // all have read
      if (hits > before) note(d, hits);
      const bool is_better =
          hits < best_count || (hits == best_count && ranksBefore(approach, normal_L, d, result.direction));
      if (!is_better) continue;
      best_count = hits;
      result.direction = static_cast<std::uint16_t>(d);
    }
  }

  if (!in_cone) {
    result.reason = PointReason::Normal;
  } else if (count == 0) {
    result.reason = PointReason::Unseen;
  } else if (best_count != kNoScore) {
    result.score = static_cast<std::uint16_t>(best_count);
    result.reason = best_count < limit ? PointReason::None : PointReason::Tool;
  }
  __syncwarp();
  return result;  // the masks are in shared memory
}

}  // namespace accessvdb::kernels
