// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Colliding voxels of a leaf by cells of 4 x 4 x 4: one byte per cell, eight cells in the eight bytes after the leaf's
/// values, which NanoVDB leaves unused. The mirror maintains them to identify leaves without collisions immediately.
#pragma once

#include <cstddef>
#include <cstdint>

#include "occupancy_query.h"

namespace accessvdb::kernels {

inline constexpr int kCellLog2 = 2;
/// Byte offset of the counts in a leaf.
inline constexpr std::size_t kCellCountsBytes = offsetof(OccupancyLeaf::DataType, mPadding);

/// @param words  [8] one word per x, one byte per row of eight z
ACCESSVDB_HOSTDEV inline std::uint64_t countCells(const std::uint64_t* words) {
  constexpr std::uint64_t kPairs = 0x5555555555555555u, kQuads = 0x3333333333333333u, kLow = 0x0f0f0f0f0f0f0f0fu;
  std::uint64_t counts = 0;
  for (int half = 0; half < 2; ++half) {
    std::uint64_t low = 0, high = 0;  // one byte per row: its lower four z, its upper four
    for (int x = 4 * half; x < 4 * half + 4; ++x) {
      std::uint64_t v = words[x];
      v -= v >> 1 & kPairs;
      v = (v & kQuads) + (v >> 2 & kQuads);
      low += v & kLow;
      high += v >> 4 & kLow;
    }
    for (int part = 0; part < 2; ++part) {
      const auto sum = [part](std::uint64_t rows) {
        return std::uint64_t{(static_cast<std::uint32_t>(rows >> (32 * part)) * 0x01010101u) >> 24};
      };
      counts |= (sum(low) | sum(high) << 8) << (16 * (2 * half + part));
    }
  }
  return counts;
}

}  // namespace accessvdb::kernels
