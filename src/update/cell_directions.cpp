// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/cell_directions.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <utility>

#include "hostdev/cell_counts.h"
#include "update/direction_masks.h"

namespace accessvdb::internal {
namespace {

/// Bottom and top voxel of a column.
struct Ends {
  Index3 bottom, top;
};
Ends endsOf(const kernels::VoxelColumn& c) {
  return {{c.dx, c.dy, c.dz + std::countr_zero(c.bits)}, {c.dx, c.dy, c.dz + 63 - std::countl_zero(c.bits)}};
}

/// First and last cell that voxel offsets from `low` to `high` can reach, for a point anywhere in the first leaf.
std::int32_t firstCell(std::int32_t low) { return low >> kernels::kCellLog2; }
std::int32_t lastCell(std::int32_t high) { return (high + 7) >> kernels::kCellLog2; }

/// The smallest arc that contains all directions of a set: everything outside the longest gap.
kernels::DirectionArc arcOf(const DirectionMask& mask, int num_directions) {
  int last = -1;  // the last direction before the first one, minus one turn
  for (int d = 0; d < num_directions; ++d) {
    if (mask.test(d)) last = d - num_directions;
  }
  if (last == -1 && !mask.test(num_directions - 1)) return {};
  int first = 0, longest = 0;
  for (int d = 0; d < num_directions; ++d) {
    if (!mask.test(d)) continue;
    if (d - last > longest) {
      longest = d - last;
      first = d;
    }
    last = d;
  }
  return {static_cast<std::uint8_t>(first), static_cast<std::uint16_t>(num_directions - longest + 1)};
}

}  // namespace

CellDirections::CellDirections(const kernels::ToolKernelView& tool, int num_directions, int group_log2, bool as_sets,
                               std::uint64_t most_bytes) {
  const std::uint32_t columns = tool.use_samples ? 0 : tool.column_begin[num_directions * tool.parts];
  if (columns == 0) return;
  Index3 last;
  low_.fill(std::numeric_limits<std::int32_t>::max());
  last.fill(std::numeric_limits<std::int32_t>::min());
  for (std::uint32_t n = 0; n < columns; ++n) {
    const Ends ends = endsOf(tool.columns[n]);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low_[axis] = std::min(low_[axis], firstCell(ends.bottom[axis]));
      last[axis] = std::max(last[axis], lastCell(ends.top[axis]));
    }
  }
  // Distance in cells between the first leaf of a group and the farthest one.
  const std::int32_t others = ((1 << group_log2) - 1) << (3 - kernels::kCellLog2);
  std::uint64_t entries = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    size_[axis] = last[axis] + others - low_[axis] + 1;
    entries *= static_cast<std::uint64_t>(size_[axis]);
  }
  if (entries * sizeof(DirectionMask) > most_bytes) return;
  std::vector<DirectionMask> masks(entries);
  for (int d = 0; d < num_directions; ++d) {
    // All parts of a direction: what is freed in the union of its rolls takes at most one from their minimum.
    const int first = d * tool.parts, mark = kernels::isWide(num_directions) ? 0 : d;
    for (std::uint32_t n = tool.column_begin[first]; n < tool.column_begin[first + tool.parts]; ++n) {
      const Ends ends = endsOf(tool.columns[n]);
      for (std::int32_t x = firstCell(ends.bottom[0]); x <= lastCell(ends.top[0]); ++x) {
        for (std::int32_t y = firstCell(ends.bottom[1]); y <= lastCell(ends.top[1]); ++y) {
          std::size_t at =
              static_cast<std::size_t>((x - low_[0]) * size_[1] + (y - low_[1])) * static_cast<std::size_t>(size_[2]) +
              static_cast<std::size_t>(firstCell(ends.bottom[2]) - low_[2]);
          for (std::int32_t z = firstCell(ends.bottom[2]); z <= lastCell(ends.top[2]); ++z, ++at) {
            masks[at].set(mark);
          }
        }
      }
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) spreadMasks(masks, size_, axis, others);
  if (as_sets) {
    sets_ = std::move(masks);
    return;
  }
  table_.reserve(entries);
  for (const DirectionMask& mask : masks) table_.push_back(arcOf(mask, num_directions));
}

}  // namespace accessvdb::internal
