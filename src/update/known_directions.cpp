// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/known_directions.h"

#include <algorithm>
#include <bit>

#include "hostdev/cell_counts.h"

namespace accessvdb::internal {

void FreedVoxels::add(const CellDirections& cells, int num_directions, const Index3& offset, std::uint64_t freed) {
  if (freed == 0) return;
  ++leaves_;
  for (int cell = 0; cell < 8; ++cell) {
    const auto count = static_cast<std::uint32_t>(freed >> (8 * cell)) & 0xffu;
    if (count == 0) continue;
    std::size_t entry = 0;
    bool inside = true;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t i = offset[axis] * 2 + (cell >> (2 - axis) & 1) - cells.low()[axis];
      inside = inside && i >= 0 && i < cells.size()[axis];
      entry = entry * static_cast<std::size_t>(cells.size()[axis]) + static_cast<std::size_t>(i);
    }
    if (!inside) continue;
    if (!cells.sets().empty()) {
      // Steps, as below: up where a run of directions begins, down where it ends.
      const DirectionMask& set = cells.sets()[entry];
      std::uint64_t before = 0;
      for (std::size_t w = 0; w < kernels::kMaxDirectionWords; ++w) {
        const std::uint64_t bits = set.word[w], shifted = bits << 1 | before;
        before = bits >> 63;
        for (std::uint64_t up = bits & ~shifted; up != 0; up &= up - 1) {
          steps_[64 * w + static_cast<std::size_t>(std::countr_zero(up))] += count;
        }
        for (std::uint64_t down = shifted & ~bits; down != 0; down &= down - 1) {
          steps_[64 * w + static_cast<std::size_t>(std::countr_zero(down))] -= count;
        }
      }
      continue;
    }
    const kernels::DirectionArc arc = cells.table()[entry];
    if (arc.count == 0) continue;
    const auto directions = static_cast<std::uint32_t>(num_directions);
    const std::uint32_t end = arc.first + std::uint32_t{arc.count};
    steps_[arc.first] += count;
    if (end < directions) {
      steps_[end] -= count;
    } else if (end > directions) {  // wraps around
      steps_[0] += count;
      steps_[end - directions] -= count;
    }
  }
}

const std::uint32_t* FreedVoxels::sum(int num_directions) {
  const auto directions = static_cast<std::size_t>(num_directions);
  for (std::size_t d = 1; d < directions; ++d) steps_[d] += steps_[d - 1];
  std::fill(steps_.begin() + num_directions, steps_.end(), 0u);
  return steps_.data();
}

KnownDirections::KnownDirections(const kernels::ToolKernelView& tool, int num_directions, bool any_directions)
    : num_directions_(num_directions),
      words_(static_cast<std::size_t>(num_directions + kernels::kKnownPerWord - 1) / kernels::kKnownPerWord),
      scale_(kernels::KnownScale::forLimit(tool.collision_limit)),
      cells_(tool, num_directions, 0, any_directions),
      levels_((words_ + known_rows::kWords - 1) / known_rows::kWords),
      freed_(words_) {}

void KnownDirections::grow(std::size_t points, std::size_t blocks) {
  levels_.grow(points);
  freed_.grow(blocks);
}

KnownDirections::LowestLevels KnownDirections::lowestWithMore(std::uint32_t block) {
  LowestLevels lowest;
  lowest.fill(kernels::known_word::kEach);
  const kernels::FreedWord* const freed = freed_.row(block);
  for (std::size_t w = 0; w < words_; ++w) lowest[w] = freed[w].lowestWithMore(scale_.levels.log2);
  return lowest;
}

void KnownDirections::age(std::uint32_t block, std::span<const std::uint32_t> ids, FreedVoxels& freed,
                          const DirectionMask& better_tool) {
  std::array<std::uint64_t, kMostWords> less = {};
  const std::uint32_t* sums = freed.sum(num_directions_);
  std::array<std::size_t, kMostWords / known_rows::kWords> wanted = {};  // first words of parts of a row
  std::size_t parts = 0;
  for (std::size_t w = 0; w < words_; ++w) {
    if (cells_.empty()) {
      const auto directions = static_cast<std::uint32_t>(better_tool.word[w >> 3] >> (8 * (w & 7))) & 0xffu;
      less[w] = (kernels::known_word::spread(directions) >> 7) * kernels::KnownLevels::kMost;
    } else if (freed.any()) {
      freed_.row(block)[w].add(sums + kernels::kKnownPerWord * w, freed.tooMany(), scale_.levels.log2, less[w]);
    }
    const std::size_t part = w / known_rows::kWords * known_rows::kWords;
    if (less[w] != 0 && (parts == 0 || wanted[parts - 1] != part)) wanted[parts++] = part;
  }
  if (parts == 0) return;
  constexpr std::size_t kAhead = 8;  // points are scattered in memory
  for (std::size_t n = 0; n < std::min(kAhead, ids.size()); ++n) prefetch(ids[n]);
  for (std::size_t n = 0; n < ids.size(); ++n) {
    if (n + kAhead < ids.size()) prefetch(ids[n + kAhead]);
    std::uint64_t* const levels = levelsOf(ids[n]);
    for (std::size_t p = 0; p < parts; ++p) known_rows::lower(levels + wanted[p], less.data() + wanted[p]);
  }
}

void KnownDirections::forgetCorridors(std::uint32_t id, const DirectionMask& better_arm) {
  std::uint64_t* const levels = levelsOf(id);
  for (std::size_t n = 0; n < kernels::kMaxDirectionWords; ++n) {
    if (better_arm.word[n] == 0) continue;
    for (std::size_t w = 8 * n; w < std::min(8 * n + 8, words_); ++w) {
      const auto directions = static_cast<std::uint32_t>(better_arm.word[n] >> (8 * (w & 7))) & 0xffu;
      if (directions != 0) levels[w] &= ~kernels::known_word::spread(directions);
    }
  }
}

}  // namespace accessvdb::internal
