// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is known of the worse directions of points, and how voxels that cease to collide wear it away: each takes at
/// most one collision from a direction, so a direction stays worse as long as no more of them lie in its tool than it
/// has collisions to spare. They are counted for a whole block of points at once, by cells, and rather too many: that
/// costs time and changes nothing.
#pragma once

#include <cstdint>

#include "cuda/update_views.cuh"
#include "hostdev/cell_counts.h"

namespace accessvdb::kernels {

inline constexpr int kDirectionWords32 = 2 * kMaxDirectionWords;

/// Adds the voxels of flipped leaves in a column of leaves. One lane; `steps` is shared by the warp.
/// @param leaf  of the points  @param slot  of the column's 16 leaves in view.flips
/// @param steps  [32 kDirectionWords32] by how much more voxels, modulo 2^32, ceased to collide in the tool of each
///   direction than in that of the one before, at most
__device__ inline void countFreed(const UpdateView& view, const std::int32_t* leaf, std::uint32_t slot,
                                  std::int32_t z_low, std::int32_t z_high, std::uint32_t* steps) {
  const CellTableView& cells = view.covering;
  const auto directions = static_cast<std::uint32_t>(view.approach.num_directions);
  for (std::uint32_t n = view.flips.head[slot]; n != kNoIndex; n = view.flips.next[n]) {
    const LeafFlips& flip = view.flips.list[n];
    if (flip.freed == 0 || flip.leaf[2] < z_low || flip.leaf[2] > z_high) continue;
    for (int cell = 0; cell < 8; ++cell) {
      const auto counted = static_cast<std::uint32_t>(flip.freed >> (8 * cell)) & 0xffu;
      if (counted == 0) continue;
      std::int64_t entry = 0;
      bool inside = true;
      for (int axis = 0; axis < 3; ++axis) {
        const int i = (flip.leaf[axis] - leaf[axis]) * 2 + (cell >> (2 - axis) & 1) - cells.low[axis];
        inside = inside && i >= 0 && i < cells.size[axis];
        entry = entry * cells.size[axis] + i;
      }
      if (!inside) continue;
      const DirectionArc arc = cells.table[entry];
      if (arc.count == 0) continue;
      const std::uint32_t count = counted < LeafFlips::kManyFreed ? counted : 1u << 16;  // above all margins
      const std::uint32_t end = arc.first + std::uint32_t{arc.count};
      atomicAdd(steps + arc.first, count);
      if (end < directions) {
        atomicAdd(steps + end, 0u - count);
      } else if (end > directions) {  // round the corner
        atomicAdd(steps, count);
        atomicAdd(steps + end - directions, 0u - count);
      }
    }
  }
}

/// Sums of the steps up to each direction. A warp. @param sums  of the directions 32 w + lane
__device__ inline void sumSteps(const std::uint32_t* steps, int lane, std::uint32_t (&sums)[kDirectionWords32]) {
  constexpr unsigned kAll = 0xffffffffu;
  std::uint32_t before = 0;
#pragma unroll
  for (int w = 0; w < kDirectionWords32; ++w) {
    std::uint32_t sum = steps[32 * w + lane];
    for (int step = 1; step < 32; step *= 2) {
      const std::uint32_t below = __shfl_up_sync(kAll, sum, step);
      if (lane >= step) sum += below;
    }
    sums[w] = sum + before;
    before = __shfl_sync(kAll, sums[w], 31);
  }
}

/// Takes from the points of a block what became uncertain. A warp. @param steps  see countFreed
__device__ inline void wearPoints(const UpdateView& view, std::uint32_t block, const std::uint32_t* steps, int lane) {
  constexpr unsigned kAll = 0xffffffffu;
  const int words32 = 2 * view.points.direction_words;
  std::uint32_t mine[kDirectionWords32], any = 0;
  sumSteps(steps, lane, mine);
#pragma unroll
  for (int w = 0; w < kDirectionWords32; ++w) any |= mine[w];
  if (__ballot_sync(kAll, any != 0) == 0) return;
  const std::uint32_t first = view.index.first[block], count = view.index.count[block];
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::size_t id = view.index.ids[first + i];
    auto* stored = reinterpret_cast<std::uint32_t*>(view.state.worse) + id * static_cast<std::size_t>(words32);
    const std::uint32_t before = lane < words32 ? stored[lane] : 0;
    if (__ballot_sync(kAll, before != 0) == 0) continue;
    const std::uint32_t margin = view.state.margin[id];
    std::uint32_t after = before, worn = 0;
#pragma unroll
    for (int w = 0; w < kDirectionWords32; ++w) {
      if (w >= words32) break;
      const std::uint32_t word = __shfl_sync(kAll, before, w);
      if (word == 0) continue;
      const bool is_known = (word >> lane & 1u) != 0;
      const unsigned gone = __ballot_sync(kAll, is_known && mine[w] > margin);
      if (is_known && mine[w] <= margin && mine[w] > worn) worn = mine[w];
      if (lane == w) after &= ~gone;
    }
    worn = __reduce_max_sync(kAll, worn);
    // With little to spare all is lost again and again: better to learn it anew, with the whole margin.
    if (margin - worn < view.least_margin) after = 0;
    if (after != before) stored[lane] = after;
    if (lane == 0 && worn != 0) view.state.margin[id] = static_cast<std::uint16_t>(margin - worn);
  }
}

}  // namespace accessvdb::kernels
