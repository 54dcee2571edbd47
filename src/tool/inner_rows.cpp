// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <bit>
#include <limits>

#include "tool/tool_cells.h"

namespace accessvdb::internal {
namespace {

constexpr int kLeafSide = 8;

/// The box of some columns; size 0 where there are none.
struct ColumnBox {
  int low[3], high[3];
  explicit ColumnBox(std::span<const kernels::VoxelColumn> columns) {
    std::fill_n(low, 3, std::numeric_limits<int>::max());
    std::fill_n(high, 3, std::numeric_limits<int>::min());
    for (const kernels::VoxelColumn& c : columns) {
      const int bottom[3] = {c.dx, c.dy, c.dz + std::countr_zero(c.bits)};
      const int top[3] = {c.dx, c.dy, c.dz + 63 - std::countl_zero(c.bits)};
      for (int axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], bottom[axis]);
        high[axis] = std::max(high[axis], top[axis]);
      }
    }
    if (columns.empty()) std::fill_n(low, 3, 0), std::fill_n(high, 3, -1);
  }
  [[nodiscard]] int size(int axis) const { return high[axis] - low[axis] + 1; }
};

}  // namespace

InnerRows InnerRows::make(std::span<const std::span<const kernels::VoxelColumn>> inner) {
  InnerRows out;
  out.tile_begin.push_back(0);
  for (const auto& columns : inner) {
    const ColumnBox box(columns);
    if (box.size(2) > 64) return {};
    const auto first = static_cast<std::uint32_t>(out.rows.size());
    const int size_x = box.size(0), size_y = box.size(1);
    out.boxes.push_back({first, static_cast<std::int16_t>(box.low[0]), static_cast<std::int16_t>(box.low[1]),
                         static_cast<std::int16_t>(box.low[2]), static_cast<std::int16_t>(size_x),
                         static_cast<std::int16_t>(size_y)});
    out.rows.resize(first + static_cast<std::size_t>(size_x) * static_cast<std::size_t>(size_y), 0);
    const auto row = [&](int x, int y) -> std::uint64_t& {
      return out
          .rows[first + static_cast<std::size_t>(x) * static_cast<std::size_t>(size_y) + static_cast<std::size_t>(y)];
    };
    for (const kernels::VoxelColumn& c : columns) {
      const int shift = c.dz - box.low[2];  // negative where the lowest bits are empty
      row(c.dx - box.low[0], c.dy - box.low[1]) |= shift >= 0 ? c.bits << shift : c.bits >> -shift;
    }
    for (int phase = 0; phase < kLeafSide; ++phase) {
      for (int x = 0; x < size_x; ++x) {
        // The first row of a tile lies at a multiple of 8 in the map.
        for (int y = -((box.low[1] + phase) & (kLeafSide - 1)); y < size_y; y += kLeafSide) {
          bool any = false;
          for (int k = std::max(y, 0); k < std::min(y + kLeafSide, size_y); ++k) any = any || row(x, k) != 0;
          if (!any) continue;
          out.tiles.push_back({static_cast<std::int16_t>(box.low[0] + x), static_cast<std::int16_t>(box.low[1] + y)});
        }
      }
      out.tile_begin.push_back(static_cast<std::uint32_t>(out.tiles.size()));
    }
  }
  return out;
}

}  // namespace accessvdb::internal
