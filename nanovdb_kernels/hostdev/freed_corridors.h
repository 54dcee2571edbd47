// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which corridors may have become free at a point, or blocked, from the voxels of a leaf that did. All corridors lie
/// at the height of their point.
#pragma once

#include <cstdint>

#include "hostdev/direction_mask.h"
#include "hostdev/occupancy_query.h"

namespace accessvdb::kernels {

/// Voxels of a leaf that became free for a corridor, or ceased to be: each is at one of the heights and in one of the
/// columns. That may name too many, which costs time and changes no result.
struct ColumnsForArm {
  std::uint64_t columns = 0;  ///< bit 8 x + y
  std::uint32_t heights = 0;  ///< bit z
};

/// @param words  [8] LeafChange::arm_free_on or arm_free_off: bit 8 y + z of word x
ACCESSVDB_HOSTDEV inline ColumnsForArm columnsForArm(const std::uint64_t* words) {
  constexpr std::uint64_t kLow7 = 0x7f7f7f7f7f7f7f7full;
  ColumnsForArm freed;
  std::uint64_t all = 0;
  for (int x = 0; x < 8; ++x) {
    all |= words[x];
    const std::uint64_t rows = (((words[x] & kLow7) + kLow7) | words[x]) >> 7 & 0x0101010101010101ull;  // 1 or 0 each
    freed.columns |= (rows * 0x0102040810204080ull >> 56) << (8 * x);
  }
  for (int shift = 32; shift >= 8; shift /= 2) all |= all >> shift;
  freed.heights = static_cast<std::uint32_t>(all) & 0xffu;
  return freed;
}

/// For each offset in voxels, the directions that may have a sample there.
struct CorridorView {
  const DirectionMask* table = nullptr;  ///< [x][y] from -reach to reach; null: there is none
  std::int32_t reach = 0;

  [[nodiscard]] ACCESSVDB_HOSTDEV const DirectionMask* at(std::int32_t dx, std::int32_t dy) const {
    const auto x = static_cast<std::uint32_t>(dx + reach), y = static_cast<std::uint32_t>(dy + reach);
    const auto size = static_cast<std::uint32_t>(2 * reach + 1);
    return x < size && y < size ? table + static_cast<std::uint64_t>(x) * size + y : nullptr;
  }
};

/// Columns of a leaf with voxels that became free.
struct FreedColumns {
  std::uint64_t columns;        ///< ColumnsForArm::columns
  std::int32_t leaf_x, leaf_y;  ///< voxel index >> 3
};

/// Adds the directions of a point whose corridor may have a sample in a freed voxel of a leaf.
/// @param freed  of a leaf that has such voxels at the height of the point
ACCESSVDB_HOSTDEV inline void addFreedCorridors(const CorridorView& corridors, const FreedColumns& freed,
                                                const Coord& point_ijk, DirectionMask& directions) {
  const std::int32_t x = 8 * freed.leaf_x - point_ijk[0], y = 8 * freed.leaf_y - point_ijk[1];
  for (std::uint64_t columns = freed.columns; columns != 0; columns &= columns - 1) {
    const int column = lowestBit(columns);
    const DirectionMask* at = corridors.at(x + (column >> 3), y + (column & 7));
    if (at != nullptr) directions = directions | *at;
  }
}

/// Whether the corridor of a direction may have a sample in one of these columns.
/// @param blocked  of a leaf that has such voxels at the height of the point
ACCESSVDB_HOSTDEV inline bool corridorMayPass(const CorridorView& corridors, const FreedColumns& blocked,
                                              const Coord& point_ijk, int direction) {
  const std::int32_t x = 8 * blocked.leaf_x - point_ijk[0], y = 8 * blocked.leaf_y - point_ijk[1];
  for (std::uint64_t columns = blocked.columns; columns != 0; columns &= columns - 1) {
    const int column = lowestBit(columns);
    const DirectionMask* at = corridors.at(x + (column >> 3), y + (column & 7));
    if (at != nullptr && at->test(direction)) return true;
  }
  return false;
}

}  // namespace accessvdb::kernels
