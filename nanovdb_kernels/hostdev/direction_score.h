// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tests of one direction at one point: the approach corridor, then the tool.
#pragma once

#include "occupancy_query.h"

namespace accessvdb::kernels {

/// Set bits of a 32-bit word.
ACCESSVDB_HOSTDEV inline int bitCount(std::uint32_t word) {
#if defined(__CUDA_ARCH__)
  return __popc(word);
#else
  word = word - (word >> 1 & 0x55555555u);
  word = (word & 0x33333333u) + (word >> 2 & 0x33333333u);
  return static_cast<int>(((word + (word >> 4)) & 0x0f0f0f0fu) * 0x01010101u >> 24);
#endif
}

/// Outcome of the corridor test (paper, "Arm path checking").
struct ArmResult {
  int passed;          ///< samples before the first blocked one; num_arm if free
  PointReason reason;  ///< None if free; Arm: an obstacle; Unknown: unobserved and never cleared
};

/// @param map  armFree(ijk), collides(ijk)
template <class Map>
ACCESSVDB_HOSTDEV inline ArmResult testArm(const Map& map, const ApproachView& approach, int d, const float* position_L,
                                           float inverse_voxel_size) {
  const float* offset = approach.arm_offsets + 3 * static_cast<std::int64_t>(d) * approach.num_arm;
  for (int n = 0; n < approach.num_arm; ++n, offset += 3) {
    const Coord ijk =
        voxelOf(position_L[0] + offset[0], position_L[1] + offset[1], position_L[2] + offset[2], inverse_voxel_size);
    if (!map.armFree(ijk)) return {n, map.collides(ijk) ? PointReason::Arm : PointReason::Unknown};
  }
  return {approach.num_arm, PointReason::None};
}

/// Fewest collisions of the tool over the rolls of a direction, and the first roll that has them.
struct AxisCount {
  int count;
  int roll;
};

/// Collisions of the tool in direction d, whatever its roll: the minimum over its rolls, exact up to `stop_above`;
/// otherwise some larger number, which the collisions of every roll reach, and roll 0.
///
/// The core comes first. Its voxels belong to every roll, so a core that exceeds the bound settles all of them.
/// Otherwise the rolls follow, each only with the voxels that it has besides, and a bound that shrinks.
/// @param parts  ToolKernelView::parts
/// @param count  count(part, stop_above): collisions of a part, exact up to stop_above, otherwise some larger number
///   that they reach
template <class Count>
ACCESSVDB_HOSTDEV inline AxisCount countAxis(int parts, int d, int stop_above, const Count& count) {
  if (parts == 1) return {count(d, stop_above), 0};
  const int first = d * parts, core = count(first, stop_above);
  if (core > stop_above) return {core, 0};
  AxisCount best = {-1, 0};
  int bound = stop_above;  // a later roll has to be at or below it; never below the core
  int least = 0x7fffffff;  // of rolls above it
  for (int roll = 0; roll < parts - 1; ++roll) {
    const int hits = core + count(first + 1 + roll, bound - core);
    if (hits <= bound) {
      best = {hits, roll};
      if (hits == core) break;  // no roll has fewer
      bound = hits - 1;
    } else if (hits < least) {
      least = hits;
    }
  }
  return best.count >= 0 ? best : AxisCount{least, 0};
}

/// Colliding voxels of a part of the tool, placed at the point's voxel. Stops once the count exceeds `stop_above`; the
/// result is exact up to that value, otherwise some larger number.
ACCESSVDB_HOSTDEV inline int countVoxelCollisions(const OccupancyReader& map, const ToolKernelView& tool, int part,
                                                  const Coord& point_ijk, int stop_above) {
  int count = 0;
  const VoxelColumn* end = tool.columns + tool.column_begin[part + 1];
  for (const VoxelColumn* column = tool.columns + tool.column_begin[part]; column != end; ++column) {
    const std::int32_t x = point_ijk[0] + column->dx, y = point_ijk[1] + column->dy, z = point_ijk[2] + column->dz;
    const int shift = z & 7;
    std::int32_t row = z - shift;
    // First row: the lowest 8 - shift bits, moved up; then eight bits per row.
    std::uint64_t bits = column->bits;
    std::uint32_t wanted = static_cast<std::uint32_t>(bits << shift) & 0xffu;
    bits >>= 8 - shift;
    while (true) {
      if (wanted != 0) count += bitCount(map.collidesRow(Coord(x, y, row)) & wanted);
      if (bits == 0) break;
      wanted = static_cast<std::uint32_t>(bits) & 0xffu;
      bits >>= 8;
      row += 8;
    }
    if (count > stop_above) return count;
  }
  return count;
}

/// Colliding samples of a part of the tool's surface, placed at the point (paper, "Tool kernel").
/// @param map  collides(ijk)
template <class Map>
ACCESSVDB_HOSTDEV inline int countSampleCollisions(const Map& map, const ToolKernelView& tool, int part,
                                                   const float* position_L, float inverse_voxel_size, int stop_above) {
  int count = 0;
  const float* end = tool.samples + 3 * static_cast<std::int64_t>(tool.sample_begin[part + 1]);
  for (const float* t = tool.samples + 3 * static_cast<std::int64_t>(tool.sample_begin[part]); t != end; t += 3) {
    const Coord ijk = voxelOf(position_L[0] + t[0], position_L[1] + t[1], position_L[2] + t[2], inverse_voxel_size);
    count += map.collides(ijk) ? 1 : 0;
    if (count > stop_above) return count;
  }
  return count;
}

}  // namespace accessvdb::kernels
