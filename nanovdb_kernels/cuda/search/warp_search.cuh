// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// searchDirections (hostdev) with the 32 lanes of a warp, and bit for bit the same result.
///
/// Directions come in rank order, as in the plain rule. Lanes test the corridors of up to 32 of them at once; results
/// past the direction that ends the search are discarded. All lanes then count the tool's collisions one direction at a
/// time: slab by slab (slab_count.cuh), or one column or sample per lane.
#pragma once

#include <cstdint>

#include "cuda/search/direction_order.cuh"
#include "cuda/search/leaf_window.cuh"
#include "cuda/search/slab_count.cuh"
#include "hostdev/direction_search.h"

namespace accessvdb::kernels {

/// Shared memory of a searching warp. In masks, direction d is bit d % 32 of word d / 32.
struct WarpMasks {
  std::uint32_t allowed[kMaskWords32];       ///< seen and candidate
  std::uint32_t skip[kMaskWords32];          ///< known not to change the outcome
  std::uint32_t arm_blocked[kMaskWords32];   ///< found blocked in the corridor
  std::uint32_t tool_blocked[kMaskWords32];  ///< found blocked by the tool
  std::uint32_t put_off[kMaskWords32];       ///< certainly blocked, but not counted yet
  std::uint32_t counted[kMaskWords32];       ///< tool collisions were counted
  std::uint16_t least[kMostDirections];      ///< lower bound of collisions for those two
  std::uint8_t order[kMostDirections];       ///< allowed directions in rank order
};

/// For searches that know nothing about collisions.
struct NothingKnown {
  __device__ int operator()(int) const { return 0; }
};

/// Adds the counts of 32 more items, one per lane, to the count of the plain rule.
/// @return whether the plain rule stops among them; `count` is then where it stops
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

/// Counts collisions of some tool columns, and stops at the same number as the plain rule.
/// @tparam kTurns  columns in flight per lane
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

/// countVoxelCollisions with one warp.
template <int kTurns, class Window>
__device__ int countVoxelsByWarp(const Window& window, const ToolKernelView& tool, int part, const Coord& point_ijk,
                                 int stop_above, int lane) {
  return countColumnsByWarp<kTurns>(window, tool.columns, tool.column_begin[part], tool.column_begin[part + 1],
                                    point_ijk, stop_above, lane);
}

/// countSampleCollisions with one warp.
template <class Window>
__device__ int countSamplesByWarp(const Window& window, const MapOutside& map, const ToolKernelView& tool, int part,
                                  const float* position_L, float inverse_voxel_size, int stop_above, int lane) {
  int count = 0;
  const std::uint32_t end = tool.sample_begin[part + 1];
  for (std::uint32_t first = tool.sample_begin[part]; first < end; first += kWarp) {
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

/// testArm, one direction per lane.
template <class Window>
__device__ ArmResult testArmThrough(const Window& window, const MapOutside& map, const ApproachView& approach, int d,
                                    const float* position_L, float inverse_voxel_size) {
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

// How a search counts collisions. Results are exact up to `stop_above`. Beyond it, a `kPlain` counter returns the
// number at which the plain rule stops, any other some number above `stop_above` that the collisions reach. One that
// `kRolls` counts by countAxis, and leaves the roll in `roll`.

/// One column of voxels per lane. @tparam kTurns  columns in flight per lane
template <class Window, int kTurns = 2>
struct ColumnCounter {
  static constexpr bool kPlain = true, kRolls = false;
  const Window& window;
  const ToolKernelView& tool;
  const Coord& point_ijk;
  int lane;

  __device__ int operator()(int d, int stop_above) const {
    return countVoxelsByWarp<kTurns>(window, tool, d, point_ijk, stop_above, lane);
  }
};
/// One sample per lane.
template <class Window>
struct SampleCounter {
  static constexpr bool kPlain = true, kRolls = false;
  const Window& window;
  const MapOutside& map;
  const ToolKernelView& tool;
  const float* position_L;
  float inverse_voxel_size;
  int lane;

  __device__ int operator()(int d, int stop_above) const {
    return countSamplesByWarp(window, map, tool, d, position_L, inverse_voxel_size, stop_above, lane);
  }
};
/// Slab by slab. @tparam kThick, kRows  as for SlabCount
template <bool kThick, bool kRows = false>
struct SlabCounter {
  static constexpr bool kPlain = false, kRolls = false;
  SlabWork& work;  ///< for one point
  int lane;

  __device__ int operator()(int d, int stop_above) const {
    return countSlabs<kThick, kRows>(work, d, stop_above, lane);
  }
};

/// countAxis with one warp; out of line, because kernels that outgrow the instruction cache are slow.
/// @tparam Counter  of parts: SlabCounter, ColumnCounter or SampleCounter
template <class Counter>
__device__ __noinline__ AxisCount countAxisByWarp(const Counter& counter, int parts, int d, int stop_above) {
  return countAxis(parts, d, stop_above, [&](int part, int stop) { return counter(part, stop); });
}
/// The tool in all of its rolls. @tparam kPlainly  whether it stops where the plain rule does, or says only what it has
/// to: the numbers are the same, but what a search makes of them differs
template <class Counter, bool kPlainly>
struct RollCounter {
  static constexpr bool kPlain = kPlainly, kRolls = true;
  Counter counter;  ///< of parts
  int parts;
  mutable int roll = 0;  ///< of the last count; the same in all lanes

  __device__ int operator()(int d, int stop_above) const {
    const AxisCount found = countAxisByWarp(counter, parts, d, stop_above);
    roll = found.roll;
    return found.count;
  }
};

/// Keeps counts below kNoScore, which means that no direction got this far.
__device__ inline int belowNoScore(int count) { return count < kNoScore ? count : kNoScore - 1; }

/// Takes the direction with the fewest collisions off the list of those put off. All lanes call it.
/// @return the direction, or -1 if none has at most `most`
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

/// ranksBefore, out of line: it is rarely asked, and kernels that outgrow the instruction cache are slow.
static __device__ __noinline__ bool comesBefore(const float* direction_xy, const float* axes_xyz, float x, float y,
                                                float z, int d, int e) {
  ApproachView approach;
  approach.direction_xy = direction_xy;
  approach.axes_xyz = axes_xyz;
  const float normal[3] = {x, y, z};
  return ranksBefore(approach, normal, d, e);
}
__device__ inline bool comesBefore(const ApproachView& approach, const float* normal, int d, int e) {
  return comesBefore(approach.direction_xy, approach.axes_xyz, normal[0], normal[1], normal[2], d, e);
}

/// The point that a warp searches.
struct SearchPoint {
  const float* position_L;
  const float* normal_L;
  const std::uint64_t* seen;  ///< [seen_words]
  int seen_words;
};

/// The map around that point.
template <class Window>
struct MapAround {
  const Window& window;
  const MapOutside& map;  ///< for voxels outside the window
  float inverse_voxel_size;
};

/// Inputs of a warp's search; the same for all lanes.
/// @tparam Known  known(d): a lower bound of the collisions of direction d; used only if the counter is not plain
template <class Window, class Counter, class Known = NothingKnown>
struct SearchContext {
  static constexpr bool kPlain = Counter::kPlain, kRolls = Counter::kRolls;
  MapAround<Window> around;
  const ApproachView& approach;
  SearchPoint point;
  const Counter& counter;
  int limit;  ///< [n_c]
  WarpMasks& masks;
  int lane;
  Known known = {};
  int remember_at = 0;  ///< count up to here where that is cheap, for masks.least
};

/// searchDirections with one warp. All lanes call it and get the same result.
template <class Context>
class WarpSearch {
 public:
  explicit __device__ WarpSearch(const Context& context) : c_(context), masks_(context.masks), lane_(context.lane) {}

  __device__ ScoreResult run(const ScoreItem& item) {
    ScoreResult result;
    const float* const normal_L = c_.point.normal_L;
    if (normal_L[0] == 0 && normal_L[1] == 0 && normal_L[2] == 0) return result;
    result.scored = 1;
    clearMasks(item);
    bool in_cone = false;
    const int count = orderByWarp(c_.approach, normal_L, {masks_.allowed, masks_.least, masks_.order}, in_cone, lane_);
    bool done = false;
    // The next directions in rank order, one per lane.
#pragma unroll 1
    for (int first = 0; first < count && !done; first += static_cast<int>(kWarp)) {
      const Turn turn = testCorridors(first, count, result);
      const unsigned upto = countNext(turn, done, result);
      if ((turn.skipped & upto) != 0) result.skipped = 1;
      result.tests = static_cast<std::uint16_t>(result.tests + __popc((turn.blocked | turn.free) & upto));
      if (turn.is_blocked && (upto >> lane_ & 1u) != 0) {
        atomicOr(&masks_.arm_blocked[turn.mine >> 5], 1u << (turn.mine & 31));
      }
    }
    if (!kPlain && some_put_off_ && best_count_ >= c_.limit) settlePutOff(result);
    if (!in_cone) {
      result.reason = PointReason::Normal;
    } else if (count == 0) {
      result.reason = PointReason::Unseen;
    } else if (best_count_ != kNoScore) {
      result.score = static_cast<std::uint16_t>(best_count_);
      result.reason = best_count_ < c_.limit ? PointReason::None : PointReason::Tool;
    }
    __syncwarp();
    return result;  // the masks are in shared memory
  }

 private:
  static constexpr bool kPlain = Context::kPlain;

  /// Up to 32 directions at a time, one per lane.
  struct Turn {
    int mine;                                ///< this lane's direction, or -1
    bool is_blocked;                         ///< in the corridor
    int my_least;                            ///< known lower bound of its collisions
    unsigned known, skipped, blocked, free;  ///< masks of lanes, by state of their directions
  };

  __device__ void clearMasks(const ScoreItem& item) {
    if (lane_ < kMaskWords32) {
      const int word = lane_ >> 1, half = (lane_ & 1) * 32;
      const std::uint64_t seen_word = word < c_.point.seen_words ? c_.point.seen[word] : 0;
      masks_.allowed[lane_] = static_cast<std::uint32_t>((seen_word & item.candidates.word[word]) >> half);
      masks_.skip[lane_] = static_cast<std::uint32_t>(item.skip.word[word] >> half);
      masks_.arm_blocked[lane_] = 0;
      masks_.tool_blocked[lane_] = 0;
      masks_.put_off[lane_] = 0;
      masks_.counted[lane_] = 0;
    }
    __syncwarp();
    known_score_ = item.known_score;
    known_direction_ = item.known_direction;
    if constexpr (Context::kRolls) known_roll_ = item.known_roll;
  }

  /// Tests the corridors of up to 32 directions, starting at masks.order[first].
  __device__ Turn testCorridors(int first, int count, ScoreResult& result) {
    Turn turn;
    turn.mine = first + lane_ < count ? masks_.order[first + lane_] : -1;
    const bool is_known = turn.mine >= 0 && turn.mine == known_direction_;
    const bool is_skipped = turn.mine >= 0 && !is_known && testBit(masks_.skip, turn.mine);
    ArmResult arm = {0, PointReason::None};
    const bool is_tested = turn.mine >= 0 && !is_known && !is_skipped;
    if (is_tested) {
      arm = testArmThrough(c_.around.window, c_.around.map, c_.approach, turn.mine, c_.point.position_L,
                           c_.around.inverse_voxel_size);
    }
    turn.is_blocked = is_tested && arm.reason != PointReason::None;
    turn.my_least = !kPlain && is_tested && !turn.is_blocked ? c_.known(turn.mine) : 0;
    turn.known = __ballot_sync(kAllLanes, is_known);
    turn.skipped = __ballot_sync(kAllLanes, is_skipped);
    turn.blocked = __ballot_sync(kAllLanes, turn.is_blocked);
    turn.free = __ballot_sync(kAllLanes, is_tested && !turn.is_blocked);

    // A corridor is the closest outcome only as long as no direction has got as far as the tool.
    const unsigned scored = turn.free | (known_score_ < kNoScore ? turn.known : 0u);
    const unsigned before_scored = scored == 0 ? kAllLanes : (scored & (0u - scored)) - 1;
    if (!tool_reached_ && (turn.blocked & before_scored) != 0) {
      const bool counts = turn.is_blocked && (before_scored >> lane_ & 1u) != 0;
      const int most = __reduce_max_sync(kAllLanes, counts ? arm.passed : -1);
      if (most > best_passed_) {
        const int closest = __ffs(static_cast<int>(__ballot_sync(kAllLanes, counts && arm.passed == most))) - 1;
        best_passed_ = most;
        result.reason = static_cast<PointReason>(__shfl_sync(kAllLanes, static_cast<int>(arm.reason), closest));
        result.direction = static_cast<std::uint16_t>(__shfl_sync(kAllLanes, turn.mine, closest));
      }
    }
    tool_reached_ = tool_reached_ || scored != 0;
    return turn;
  }

  /// Counts tool collisions in a turn's free directions, one after the other.
  /// @param done  set if a direction without any collision was found
  /// @return lanes whose directions the plain rule reaches
  __device__ unsigned countNext(const Turn& turn, bool& done, ScoreResult& result) {
#pragma unroll 1
    for (unsigned events = turn.known | turn.free; events != 0; events &= events - 1) {
      const int at = __ffs(static_cast<int>(events)) - 1;
      const int d = __shfl_sync(kAllLanes, turn.mine, at);
      if ((turn.known >> at & 1u) != 0) {
        takeIfLess(known_score_, d, known_roll_, result);
      } else {
        const int bound = best_count_ < known_score_ ? best_count_ : known_score_;
        int hits = 0;
        if constexpr (!kPlain) {
          // Until some direction has a count, those certainly blocked are put off: a free direction makes their counts
          // needless, and without one, the one with the fewest collisions comes first.
          const int enough = bound == kNoScore ? c_.limit - 1 : bound;
          hits = __shfl_sync(kAllLanes, turn.my_least, at);
          if (hits <= enough) {
            const int stop_above = c_.remember_at > enough ? c_.remember_at - 1 : enough;
            hits = belowNoScore(c_.counter(d, stop_above));
            note(d, hits, result);
          }
          if (hits > enough && bound == kNoScore) {
            putOff(d, hits);
            continue;
          }
        } else {
          hits = belowNoScore(c_.counter(d, bound));
          note(d, hits, result);
        }
        takeIfLess(hits, d, lastRoll(), result);
      }
      if (best_count_ == 0) {
        done = true;
        return (2u << at) - 1;
      }
    }
    return kAllLanes;
  }

  /// Counts put-off directions as long as one of them may be the best.
  __device__ void settlePutOff(ScoreResult& result) {
#pragma unroll 1
    for (int d = takePutOff(masks_, best_count_, lane_); d >= 0; d = takePutOff(masks_, best_count_, lane_)) {
      const int hits = belowNoScore(c_.counter(d, best_count_));
      const int before = masks_.least[d];
      __syncwarp();  // all have read
      if (hits > before) note(d, hits, result);
      const bool is_better = hits < best_count_ ||
                             (hits == best_count_ && comesBefore(c_.approach, c_.point.normal_L, d, result.direction));
      if (!is_better) continue;
      best_count_ = hits;
      result.direction = static_cast<std::uint16_t>(d);
      if constexpr (Context::kRolls) result.roll = static_cast<std::uint8_t>(lastRoll());
    }
  }

  /// Of the last count.
  [[nodiscard]] __device__ int lastRoll() const {
    if constexpr (Context::kRolls) {
      return c_.counter.roll;
    } else {
      return 0;
    }
  }

  __device__ void takeIfLess(int hits, int d, int roll, ScoreResult& result) {
    if (hits >= best_count_) return;
    best_count_ = hits;
    result.direction = static_cast<std::uint16_t>(d);
    if constexpr (Context::kRolls) result.roll = static_cast<std::uint8_t>(roll);
  }

  __device__ void note(int d, int hits, ScoreResult& result) {
    if (hits >= c_.limit && hits < result.least_blocked) result.least_blocked = static_cast<std::uint16_t>(hits);
    if (lane_ != 0) return;
    if (hits >= c_.limit) masks_.tool_blocked[d >> 5] |= 1u << (d & 31);
    masks_.counted[d >> 5] |= 1u << (d & 31);
    masks_.least[d] = static_cast<std::uint16_t>(hits);
  }

  __device__ void putOff(int d, int hits) {
    some_put_off_ = true;
    if (lane_ == 0) {
      masks_.put_off[d >> 5] |= 1u << (d & 31);
      masks_.least[d] = static_cast<std::uint16_t>(hits);
    }
    __syncwarp();
  }

  const Context& c_;
  WarpMasks& masks_;
  int lane_;
  int known_score_ = kNoScore, known_direction_ = kNoDirection, known_roll_ = 0;
  int best_count_ = kNoScore, best_passed_ = -1;
  bool tool_reached_ = false, some_put_off_ = false;
};

template <class Window, class Counter, class Known>
__device__ ScoreResult searchByWarp(const SearchContext<Window, Counter, Known>& context, const ScoreItem& item) {
  return WarpSearch<SearchContext<Window, Counter, Known>>(context).run(item);
}

}  // namespace accessvdb::kernels
