// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Remembers what a warp's search found out about the directions of a point (known_collisions.cuh).
#pragma once

#include <cstdint>

#include "cuda/search/warp_search.cuh"
#include "cuda/update/known_collisions.cuh"
#include "cuda/update/update_kernels.h"

namespace accessvdb::kernels {

/// What a search found out about eight directions per lane, one bit each.
struct FoundOut {
  std::uint32_t counted = 0, arm_blocked = 0;

  FoundOut() = default;
  __device__ FoundOut(const WarpMasks& masks, const KnownSlots& slots, int lane) {
    if (lane >= slots.words) return;
    const int shift = 8 * (lane & 3);
    counted = masks.counted[lane >> 2] >> shift & 0xffu;
    arm_blocked = masks.arm_blocked[lane >> 2] >> shift & 0xffu;
  }
};

/// Notes that words come into their slots, one word per lane. All lanes call it.
/// @return whether this lane's does: if two words need the same slot, the first one gets it
__device__ inline bool takeSlot(const KnownView& known, std::size_t id, std::uint32_t note, bool writes, int lane) {
  if (known.notes == nullptr) return writes;
  const KnownSlots& slots = known.slots;
  const unsigned writing = __ballot_sync(kAllLanes, writes);
  const auto isTaken = [&](int by) { return by >= 0 && (writing >> by & 1u) != 0; };
  writes = writes && !isTaken(lane - slots.slots) && !isTaken(lane - 2 * slots.slots);
  const std::uint32_t changes = __reduce_or_sync(kAllLanes, writes ? slots.changes(note, lane) : 0u);
  if (lane == 0 && changes != 0) known.notes[id] = note ^ changes;
  return writes;
}

/// Remembers what an evaluation found out, where bounds follow flips.
__device__ inline void learnCounts(const DueWork& work, std::size_t id, const WarpMasks& masks, int lane) {
  const KnownView& known = work.evaluation.known;
  const FoundOut found(masks, known.slots, lane);
  const bool writes = (found.counted | found.arm_blocked) != 0;
  if (!__any_sync(kAllLanes, writes)) return;
  if (__any_sync(kAllLanes, found.counted != 0) && lane == 0) {
    atomicOr(known.counted_bits + (id >> 5), 1u << (id & 31));
  }
  const KnownRow row(work.points, known, id);
  if (!takeSlot(known, id, row.note, writes, lane)) return;
  KnownCounts counts = row.countsOfWord(known.slots, lane);
#pragma unroll
  for (int n = 0; n < kKnownPerWord; ++n) {
    if ((found.arm_blocked >> n & 1u) != 0) counts.of[n] |= known_count::kArmBlocked;
    if ((found.counted >> n & 1u) == 0) continue;
    // Where the tool was counted, the corridor is free.
    counts.of[n] = known_count::learnt(known_count::boundOf(counts.of[n]), masks.least[lane * kKnownPerWord + n]);
  }
  row.counts[known.slots.slotOf(lane)] = counts;
}

/// Remembers what an evaluation found out, one word of directions per lane.
/// @param searched  whether the masks are of this point   @param before, after  baseCollisions
__device__ inline void learn(const DueWork& work, std::size_t id, const WarpMasks& masks, bool searched, int before,
                             int after, int lane) {
  const KnownView& known = work.evaluation.known;
  if (!known.remembers()) return;
  if (known.follows) {
    if (searched) learnCounts(work, id, masks, lane);
    return;
  }
  const KnownSlots& slots = known.slots;
  const FoundOut found = searched ? FoundOut(masks, slots, lane) : FoundOut();
  const bool learns = (found.counted | found.arm_blocked) != 0 || (lane < slots.words && before != after);
  if (!__any_sync(kAllLanes, learns)) return;
  const KnownRow row(work.points, known, id);
  bool writes = false;
  std::uint64_t levels = 0;
  if (learns) {
    const KnownLevels& scale = known.scale;
    const KnownWord word = row.wordOf(slots, lane);
    // Where the tool was counted, the corridor is free.
    levels = (word.levels & ~known_word::spread(found.counted)) | known_word::spread(found.arm_blocked);
    if (before != after) levels = known_word::rebased(levels, after - before, scale.log2);
#pragma unroll 1
    for (std::uint32_t bits = found.counted; bits != 0; bits &= bits - 1) {
      const int n = __ffs(static_cast<int>(bits)) - 1;
      const std::uint32_t level =
          scale.levelOf(masks.least[lane * kKnownPerWord + n] - after, word.freed.count(n, scale.log2));
      if (level > known_word::levelIn(levels, n)) levels = known_word::withLevel(levels, n, level);
    }
    writes = levels != word.levels;
  }
  if (takeSlot(known, id, row.note, writes, lane)) row.levels[slots.slotOf(lane)] = levels;
}

}  // namespace accessvdb::kernels
