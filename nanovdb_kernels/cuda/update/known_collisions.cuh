// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is known about collisions in the directions of points: bounds that follow flips (follow_flips.cu), or levels
/// (hostdev/known_levels.h) and how they age. A voxel that stops colliding removes at most one collision from a
/// direction. So we count for each group of blocks and direction, as an upper bound, how many did since the group's
/// levels were last lowered; a level guarantees that many fewer. Freed voxels are counted per group, by cells.
/// Overcounting costs time but changes nothing.
#pragma once

#include <cstdint>

#include "cuda/search/warp.cuh"
#include "cuda/update/update_kernels.h"
#include "hostdev/cell_counts.h"
#include "hostdev/known_counts.h"
#include "hostdev/known_levels.h"

namespace accessvdb::kernels {

inline constexpr int kDirectionWords32 = 2 * kMaxDirectionWords;

/// At most this many leaves are counted per group and update: with eight full cells each they add up to 2^31, so that
/// no 32-bit sum overflows, even with what a counter held before. If there are more, all that is known is forgotten
/// (agePoints).
inline constexpr std::uint32_t kMostCountedLeaves = (1u << 31) / (8u << (3 * kCellLog2));

/// countFreed for directions of any kind: a step up where a run of directions begins, down where it ends.
__device__ inline void stepSet(const DirectionMask& set, std::uint32_t count, std::uint32_t* steps) {
  std::uint64_t before = 0;
#pragma unroll 1
  for (int w = 0; w < kMaxDirectionWords; ++w) {
    const std::uint64_t bits = set.word[w], shifted = bits << 1 | before;
    before = bits >> 63;
#pragma unroll 1
    for (std::uint64_t up = bits & ~shifted; up != 0; up &= up - 1) atomicAdd(steps + 64 * w + lowestBit(up), count);
#pragma unroll 1
    for (std::uint64_t down = shifted & ~bits; down != 0; down &= down - 1) {
      atomicAdd(steps + 64 * w + lowestBit(down), 0u - count);
    }
  }
}

/// Adds the voxels that stopped colliding in one cell of a leaf. One lane per cell; `steps` is shared by the warp.
/// @tparam kSets  whether the cells have a set of directions each (CellTableView::sets), or an arc
/// @param leaf  first leaf of the points' group
/// @param steps  [32 kDirectionWords32] upper bound of the voxels that stopped colliding in the tool at each direction,
///   minus that of the direction before, modulo 2^32
template <bool kSets>
__device__ void countFreed(const FlipContext& context, const std::int32_t* leaf, const LeafFlips& flip, int cell,
                           std::uint32_t* steps) {
  const auto counted = static_cast<std::uint32_t>(flip.freed >> (8 * cell)) & 0xffu;
  if (counted == 0) return;
  const CellTableView& cells = context.covering;
  std::int64_t entry = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int i = (flip.leaf[axis] - leaf[axis]) * 2 + (cell >> (2 - axis) & 1) - cells.low[axis];
    if (i < 0 || i >= cells.size[axis]) return;
    entry = entry * cells.size[axis] + i;
  }
  // A count above the cell's number of voxels means that some stopped colliding several times. No direction has lost
  // more collisions than the cell has voxels. So LeafFlips::kManyFreed needs no special case.
  constexpr std::uint32_t kVoxelsOfCell = 1u << (3 * kCellLog2);
  static_assert(LeafFlips::kManyFreed >= kVoxelsOfCell);
  const std::uint32_t count = counted < kVoxelsOfCell ? counted : kVoxelsOfCell;
  if constexpr (kSets) {
    stepSet(cells.sets[entry], count, steps);
  } else {
    const DirectionArc arc = cells.table[entry];
    if (arc.count == 0) return;
    const auto directions = static_cast<std::uint32_t>(context.num_directions);
    const std::uint32_t end = arc.first + std::uint32_t{arc.count};
    atomicAdd(steps + arc.first, count);
    if (end < directions) {
      atomicAdd(steps + end, 0u - count);
    } else if (end > directions) {  // wraps around
      atomicAdd(steps, count);
      atomicAdd(steps + end - directions, 0u - count);
    }
  }
}

/// Sums of the steps up to each direction. One warp calls it. @param sums  out: of the directions 32 w + lane
__device__ inline void sumSteps(const std::uint32_t* steps, int lane, std::uint32_t (&sums)[kDirectionWords32]) {
  std::uint32_t before = 0;
#pragma unroll
  for (int w = 0; w < kDirectionWords32; ++w) {
    sums[w] = sumUpTo(steps[32 * w + lane], lane) + before;
    before = __shfl_sync(kAllLanes, sums[w], 31);
  }
}

/// What is known about eight directions of a point.
struct KnownWord {
  std::uint64_t levels;
  FreedWord freed;
};

/// What is known about eight directions where bounds follow flips.
struct alignas(16) KnownCounts {
  std::uint16_t of[kKnownPerWord];

  [[nodiscard]] static __device__ KnownCounts unknown() {
    KnownCounts counts;
#pragma unroll
    for (std::uint16_t& count : counts.of) count = known_count::kUnknown;
    return counts;
  }
  /// Directions that need no test, one bit each: those with a blocked corridor, or with more collisions than this.
  [[nodiscard]] __device__ std::uint32_t worse(int most) const {
    std::uint32_t bits = 0;
#pragma unroll
    for (int n = 0; n < kKnownPerWord; ++n) {
      const std::uint16_t bound = known_count::boundOf(of[n]);
      const bool above = bound != known_count::kUnknown && bound > most;
      bits |= (above || (of[n] & known_count::kArmBlocked) != 0 ? 1u : 0u) << n;
    }
    return bits;
  }
};

/// Where what is known about a point is.
struct KnownRow {
  std::uint64_t* levels;   ///< [slots.slots]
  const FreedWord* freed;  ///< [slots.words] of its group
  KnownCounts* counts;     ///< [slots.slots] in place of both, where bounds follow flips; else null
  std::uint32_t note;      ///< what the slots hold

  __device__ KnownRow(const PointsView& points, const KnownView& known, std::size_t id)
      : levels(known.follows ? nullptr : levelsOf(known, id)),
        freed(known.follows ? nullptr
                            : known.freed + points.groupOf(static_cast<std::uint32_t>(id)) *
                                                static_cast<std::size_t>(known.slots.words)),
        counts(known.follows ? countsOf(known, id) : nullptr),
        note(noteOf(known, id)) {}

  [[nodiscard]] __device__ KnownWord wordOf(const KnownSlots& slots, int word) const {
    return {slots.holds(note, word) ? levels[slots.slotOf(word)] : 0, freed[word]};
  }
  [[nodiscard]] __device__ KnownCounts countsOfWord(const KnownSlots& slots, int word) const {
    return slots.holds(note, word) ? counts[slots.slotOf(word)] : KnownCounts::unknown();
  }

  [[nodiscard]] static __device__ std::uint64_t* levelsOf(const KnownView& known, std::size_t id) {
    return known.levels + id * static_cast<std::size_t>(known.slots.slots);
  }
  [[nodiscard]] static __device__ KnownCounts* countsOf(const KnownView& known, std::size_t id) {
    return reinterpret_cast<KnownCounts*>(known.counts) + id * static_cast<std::size_t>(known.slots.slots);
  }
  [[nodiscard]] static __device__ std::uint32_t noteOf(const KnownView& known, std::size_t id) {
    return known.notes != nullptr ? known.notes[id] : 0;
  }
};

/// The `asked` directions that may be better than what the levels count from, or have at most `most` collisions, and
/// whose corridor is not known to be blocked. Reads a word of eight directions only if one of them is asked for.
/// @param w, asked  directions 64 w .. 64 w + 63
__device__ inline std::uint64_t notKnownWorse(const PointsView& points, const KnownView& known, std::size_t id, int w,
                                              std::uint64_t asked, int most) {
  if (!known.remembers() || asked == 0) return asked;
  const KnownRow row(points, known, id);
#pragma unroll 1
  for (int byte = 0; byte < 8 && asked >> (8 * byte) != 0; ++byte) {
    if ((asked >> (8 * byte) & 0xffu) == 0) continue;
    std::uint64_t worse = 0;
    if (row.counts != nullptr) {
      worse = row.countsOfWord(known.slots, 8 * w + byte).worse(most);
    } else {
      const KnownWord word = row.wordOf(known.slots, 8 * w + byte);
      worse = known_word::worse(word.levels, word.freed.lowestWithMore(known.scale.log2));
    }
    asked &= ~(worse << (8 * byte));
  }
  return asked;
}

/// The bound of direction d that follows flips; of an accessible point's best direction, its collisions.
__device__ inline std::uint16_t knownCount(const KnownView& known, const KnownRow& row, int d) {
  const int word = d / kKnownPerWord;
  if (!known.slots.holds(row.note, word)) return known_count::kUnknown;
  return known_count::boundOf(row.counts[known.slots.slotOf(word)].of[d % kKnownPerWord]);
}

/// Lower bound of a point's collisions in direction d; 0: nothing is known.
/// @param base  baseCollisions
__device__ inline int knownCollisions(const PointsView& points, const KnownView& known, std::size_t id, int base,
                                      int d) {
  if (!known.remembers()) return 0;
  const KnownRow row(points, known, id);
  if (row.counts != nullptr) {
    const std::uint16_t count = knownCount(known, row, d);
    return count == known_count::kUnknown ? 0 : count;
  }
  const KnownWord word = row.wordOf(known.slots, d / kKnownPerWord);
  const int n = d % kKnownPerWord;
  const std::uint32_t level = known_word::levelIn(word.levels, n);
  if (level == 0) return 0;
  const int collisions = base + known.scale.collisionsOf(level, word.freed.count(n, known.scale.log2));
  return collisions > 0 ? collisions : 0;
}

/// Calls visit(id) with the points of a group, one point per lane, lowest lanes first; kNoIndex: none. All lanes call
/// it.
template <class Visit>
__device__ void forEachPoint(const FlipContext& context, std::uint32_t group, int lane, const Visit& visit) {
  const BlockIndexView& index = context.index;
  const std::int32_t* leaf = context.groups.leaf + 3 * static_cast<std::size_t>(group);
  const int log2 = context.groups.log2, last = (1 << log2) - 1, blocks = 1 << (3 * log2);
  for (int base = 0; base < blocks; base += 32) {
    const int n = base + lane;
    std::uint32_t block = kNoIndex;
    if (n < blocks) {
      block = index.find(leaf[0] + (n >> (2 * log2)), leaf[1] + (n >> log2 & last), leaf[2] + (n & last));
    }
    const std::uint32_t first = block != kNoIndex ? index.first[block] : 0;
    const std::uint32_t count = block != kNoIndex ? index.count[block] : 0;
    const std::uint32_t end = sumUpTo(count, lane);  // points in the blocks of the lanes up to this one
    const std::uint32_t all = __shfl_sync(kAllLanes, end, 31);
    for (std::uint32_t from = 0; from < all; from += 32) {
      const std::uint32_t at = from + static_cast<std::uint32_t>(lane);
      int owner = 0;  // the first lane with at < end
      for (int step = 16; step > 0; step /= 2) {
        if (__shfl_sync(kAllLanes, end, owner + step - 1) <= at) owner += step;
      }
      const std::uint32_t begin = __shfl_sync(kAllLanes, end - count, owner),
                          ids = __shfl_sync(kAllLanes, first, owner);
      visit(at < all ? index.ids[ids + (at - begin)] : kNoIndex);
    }
  }
}

/// Leaves around a group in which voxels became free for a corridor, or ceased to be, in memory that a warp shares.
struct LeavesOfArm {
  static constexpr int kMost = 256, kMostColumns = 256;
  std::uint32_t index[kMost];                 ///< in FlipsView::list
  std::uint32_t at_height[kMost / kWarp][8];  ///< [n / 32][z] bit n % 32: it has such voxels at this height
  int count;
  union {
    std::uint32_t columns[kMostColumns];  ///< until the leaves are listed: columns of flips that hold them
    DirectionMask of_point[kWarp];        ///< then: the directions that they concern, of 32 points
  };
};

/// A leaf with more freed columns is taken as a whole.
inline constexpr int kMostFreedColumns = 16;

/// Directions of a point whose corridor may have become free. One lane calls it.
__device__ inline DirectionMask freedCorridors(const FlipContext& context, const LeafFlips* flips,
                                               const LeavesOfArm& leaves, const std::int32_t* group_leaf,
                                               std::uint32_t id) {
  const float* p = context.points.position_L + 3 * std::size_t{id};
  const Coord ijk = voxelOf(p[0], p[1], p[2], context.inverse_voxel_size);
  DirectionMask directions = {};
#pragma unroll 1
  for (int first = 0; first < leaves.count; first += static_cast<int>(kWarp)) {
#pragma unroll 1
    for (std::uint32_t left = leaves.at_height[first / kWarp][ijk[2] & 7]; left != 0; left &= left - 1) {
      const LeafFlips& flip = flips[leaves.index[first + __ffs(static_cast<int>(left)) - 1]];
      if (flip.leaf[2] != ijk[2] >> 3) continue;
      if (__popcll(flip.freed_columns) <= kMostFreedColumns) {
        addFreedCorridors(context.corridors, {flip.freed_columns, flip.leaf[0], flip.leaf[1]}, ijk, directions);
      } else {
        const FootprintPlace at = context.footprint.at(flip.leaf[0] - group_leaf[0], flip.leaf[1] - group_leaf[1]);
        if (at.arm != 0) directions = directions | context.footprint.arm[at.arm - 1].directions;
      }
    }
  }
  return directions;
}

/// Whether the corridor of a point's best direction may have become blocked. One lane calls it.
__device__ inline bool bestArmMayBeBlocked(const FlipContext& context, const LeafFlips* flips,
                                           const LeavesOfArm& leaves, std::uint32_t id) {
  const float* p = context.points.position_L + 3 * std::size_t{id};
  const Coord ijk = voxelOf(p[0], p[1], p[2], context.inverse_voxel_size);
  const int direction = context.points.direction[id];
#pragma unroll 1
  for (int first = 0; first < leaves.count; first += static_cast<int>(kWarp)) {
#pragma unroll 1
    for (std::uint32_t left = leaves.at_height[first / kWarp][ijk[2] & 7]; left != 0; left &= left - 1) {
      const LeafFlips& flip = flips[leaves.index[first + __ffs(static_cast<int>(left)) - 1]];
      if (flip.leaf[2] != ijk[2] >> 3) continue;
      if (corridorMayPass(context.corridors, {flip.blocked_columns, flip.leaf[0], flip.leaf[1]}, ijk, direction)) {
        return true;
      }
    }
  }
  return false;
}

/// What flips mean for what is known about the points of a group.
struct Ageing {
  std::uint32_t* steps;      ///< see countFreed; overwritten
  bool too_many;             ///< there are more leaves than kMostCountedLeaves: the steps are too low
  std::uint32_t better_arm;  ///< directions 32 (lane / 4) .. + 31 whose corridor may have become free
  const LeafFlips* flips;
  LeavesOfArm* leaves;  ///< to decide point by point; null: `better_arm` decides for all
};

/// Directions that may have become better at a point of a group: fewer than the masks by leaf name. Spread over the
/// warp.
struct Improvable {
  std::uint32_t tool;  ///< directions 32 lane .. 32 lane + 31 in the first kDirectionWords32 lanes; all ones in others
  std::uint32_t arm;   ///< directions 8 lane .. 8 lane + 7
};

/// Marks the accessible points of a group whose best direction's corridor may have become blocked. One warp calls it.
/// @param leaves  null: there are too many to look  @param bits  GroupMasksView::arm_bits
__device__ inline void markBlocked(const FlipContext& context, std::uint32_t group, const LeafFlips* flips,
                                   const LeavesOfArm* leaves, std::uint32_t* bits, int lane) {
  forEachPoint(context, group, lane, [&](std::uint32_t id) {
    if (id == kNoIndex || context.points.label[id] != PointLabel::Accessible) return;
    if (leaves == nullptr || bestArmMayBeBlocked(context, flips, *leaves, id)) {
      atomicOr(bits + (id >> 5), 1u << (id & 31));
    }
  });
}

/// Forgets which corridors are blocked, in one word of a point.
__device__ inline void forgetCorridors(const KnownView& known, std::size_t id, int slot, std::uint32_t freed) {
  KnownCounts& of_word = KnownRow::countsOf(known, id)[slot];
  KnownCounts counts = of_word;
  bool changes = false;
#pragma unroll
  for (int n = 0; n < kKnownPerWord; ++n) {
    if ((freed >> n & 1u) == 0 || (counts.of[n] & known_count::kArmBlocked) == 0) continue;
    counts.of[n] = known_count::boundOf(counts.of[n]);
    changes = true;
  }
  if (changes) of_word = counts;
}
/// The same for levels, which are lowered, too. @param less  by how much
__device__ inline void lowerLevels(const KnownView& known, std::size_t id, int slot, std::uint32_t freed,
                                   std::uint64_t less) {
  std::uint64_t& levels = KnownRow::levelsOf(known, id)[slot];
  const std::uint64_t before = levels;
  if (before == 0) return;  // nothing is known
  const std::uint64_t after = known_word::lowered(before, less) & ~known_word::spread(freed);
  if (after != before) levels = after;
}

/// Ages what is known about the points of a group. One warp calls it. @return the directions that may have become
/// better
__device__ inline Improvable agePoints(const FlipContext& context, std::uint32_t group, const Ageing& ageing,
                                       int lane) {
  const KnownView& known = context.known;
  const KnownSlots& slots = known.slots;
  const int words = slots.words;
  std::uint32_t* const steps = ageing.steps;
  std::uint32_t sums[kDirectionWords32];
  sumSteps(steps, lane, sums);
  __syncwarp();  // all have read
  Improvable improvable = {kAllLanes, 0};
#pragma unroll
  for (int w = 0; w < kDirectionWords32; ++w) {
    steps[32 * w + lane] = 32 * w + lane < context.num_directions ? sums[w] : 0;
    const unsigned some = __ballot_sync(kAllLanes, sums[w] != 0 || ageing.too_many);
    if (lane == w) improvable.tool = some;
  }
  __syncwarp();
  // Lane n takes word n.
  const std::uint32_t arms = ageing.better_arm >> (8 * (lane & 3)) & 0xffu;
  std::uint64_t less = 0;
  bool ages = false;
  if (known.follows) {
    // followFlips() reads them, once all flips are there.
    std::uint16_t* const lost = known.lost + group * static_cast<std::size_t>(words * kKnownPerWord);
    for (int d = lane; d < words * kKnownPerWord; d += static_cast<int>(kWarp)) {
      lost[d] = static_cast<std::uint16_t>(ageing.too_many || steps[d] > 0xffffu ? 0xffffu : steps[d]);
    }
  } else if (lane < words) {
    FreedWord& counter = known.freed[group * static_cast<std::size_t>(words) + static_cast<std::size_t>(lane)];
    FreedWord freed = counter;
    ages = freed.add(steps + kKnownPerWord * lane, ageing.too_many, known.scale.log2, less);
    counter = freed;
  }
  if (!__any_sync(kAllLanes, ages || arms != 0)) return improvable;
  const bool all_age = __any_sync(kAllLanes, ages) != 0;
  const std::int32_t* const leaf = context.groups.leaf + 3 * static_cast<std::size_t>(group);
  forEachPoint(context, group, lane, [&](std::uint32_t id) {
    bool changes = id != kNoIndex;
    if (ageing.leaves != nullptr) {
      __syncwarp();  // all have read what is overwritten
      if (changes) {
        const DirectionMask freed = freedCorridors(context, ageing.flips, *ageing.leaves, leaf, id);
        ageing.leaves->of_point[lane] = freed;
        changes = all_age || any(freed);
      }
      __syncwarp();
    }
    // One point after the other, one word per lane.
#pragma unroll 1
    for (unsigned left = __ballot_sync(kAllLanes, changes); left != 0; left &= left - 1) {
      const int of_lane = lowestBit(left);
      const std::size_t of = __shfl_sync(kAllLanes, id, of_lane);
      if (lane >= words) continue;
      std::uint32_t freed = arms;
      if (ageing.leaves != nullptr) {
        static_assert(sizeof(DirectionMask) == kWarp);
        freed = reinterpret_cast<const std::uint8_t*>(&ageing.leaves->of_point[of_lane])[lane];
      }
      improvable.arm |= freed;
      if ((!ages && freed == 0) || !slots.holds(KnownRow::noteOf(known, of), lane)) continue;
      if (known.follows) {
        forgetCorridors(known, of, slots.slotOf(lane), freed);
      } else {
        lowerLevels(known, of, slots.slotOf(lane), freed, less);
      }
    }
  });
  return improvable;
}

}  // namespace accessvdb::kernels
