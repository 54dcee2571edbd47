// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the rules see: trivially copyable, non-owning views that travel to a kernel by value.
///
/// Frame L: the local frame, world minus the recorded origin, metres, float32. Voxel of p_L: round(p_L / v).
#pragma once

#include <cstdint>
#include <type_traits>

#include "accessvdb/point_label.h"
#include "nanovdb_compat.h"

namespace accessvdb::kernels {

/// Most direction words: D <= 256.
inline constexpr int kMaxDirectionWords = 4;
/// Most samples along the approach corridor.
inline constexpr int kMaxArmSamples = 64;

/// A set of directions, bit d of word d/64.
struct DirectionMask {
  std::uint64_t word[kMaxDirectionWords];

  ACCESSVDB_HOSTDEV bool test(int d) const { return (word[d >> 6] >> (d & 63)) & 1u; }
  ACCESSVDB_HOSTDEV void set(int d) { word[d >> 6] |= std::uint64_t(1) << (d & 63); }
  ACCESSVDB_HOSTDEV void reset(int d) { word[d >> 6] &= ~(std::uint64_t(1) << (d & 63)); }
};

/// The map as scoring needs it: value bit = collides, active bit = arm_free. A missing leaf means: tool free, arm
/// blocked.
struct OccupancyView {
  const OccupancyGrid* grid = nullptr;
  float inverse_voxel_size = 0;  ///< [1/m]
};

/// A vertical run of up to 64 tool voxels relative to the voxel of the surface point: bit i = (dx, dy, dz + i).
/// Neighbours in the list of a direction are neighbours in the map, most of them.
struct VoxelColumn {
  std::int16_t dx, dy, dz, unused;
  std::uint64_t bits;
};
static_assert(sizeof(VoxelColumn) == 16);

/// Some of 16 cells of 4 x 4 x 4 voxels above each other, in cells from the cell of the point's voxel: bit i =
/// (dx, dy, dz + i).
struct CellRun {
  std::int16_t dx, dy, dz;
  std::uint16_t bits;
};
static_assert(sizeof(CellRun) == 8);
/// Places of a voxel in its cell: (x & 3) * 16 + (y & 3) * 4 + (z & 3).
inline constexpr int kCellPhases = 64;

/// Box of voxels relative to the voxel of the surface point, inclusive. low > high: not known.
struct VoxelBox {
  std::int32_t low[3] = {1, 1, 1}, high[3] = {0, 0, 0};
};

/// The tool at every direction d, tip at the origin, self-exclusion already applied.
struct ToolKernelView {
  const VoxelColumn* columns = nullptr;         ///< voxel form: columns of d are [column_begin[d], column_begin[d+1])
  const std::uint32_t* column_begin = nullptr;  ///< [D + 1]
  const float* samples = nullptr;               ///< sample form: 3 floats a sample, metres, rotated to d
  const std::uint32_t* sample_begin = nullptr;  ///< [D + 1]
  bool use_samples = false;
  std::uint16_t collision_limit = 1;  ///< [n_c] a direction is free when its count is below
  VoxelBox reach = {};                ///< holds every voxel of every direction
};

/// Cells of the tool's voxel form, for every direction d and every place of the point's voxel in its cell: runs of
/// (d, phase) are [begin[d * kCellPhases + phase], the next). All null: not known.
struct CellRunsView {
  const CellRun* runs = nullptr;
  const std::uint32_t* begin = nullptr;  ///< [D * kCellPhases + 1]
};
/// Up to 8 rows of the tool's inner columns, (dx, dy .. dy + 7), that lie in one row of leaves of the map.
struct RowTile {
  std::int16_t dx, dy;
};
/// The inner columns of the tool at each direction as dense rows, z upwards from `dz`: row (dx, dy) of direction d is
/// rows[box[d].first + (dx - box[d].dx) * box[d].size_y + dy - box[d].dy], bit i = dz + i.
struct InnerBox {
  std::uint32_t first;
  std::int16_t dx, dy, dz, size_x, size_y;
};
struct InnerRowsView {
  const std::uint64_t* rows = nullptr;
  const InnerBox* box = nullptr;  ///< [D]
  const RowTile* tiles = nullptr;
  /// [D * 8 + 1] tiles of direction d for points with y & 7 = n: [tile_begin[d * 8 + n], the next)
  const std::uint32_t* tile_begin = nullptr;
};
/// What bounds the tool's collisions without counting them, on a map that holds cell counts (hostdev/cell_counts.h).
struct ToolCellsView {
  CellRunsView inside;                   ///< cells that the tool covers whole
  CellRunsView beside;                   ///< the other cells that its inner columns touch
  const std::uint32_t* inner = nullptr;  ///< [D] where the inner columns of d begin; no other has a voxel in `inside`
  InnerRowsView rows;                    ///< the inner columns once more; null where they are higher than 64 voxels
};

/// Directions and the corridor: tables computed once on the host.
struct ApproachView {
  const float* direction_xy = nullptr;  ///< [2 D] cos and sin of yaw 2 pi d / D
  const float* arm_offsets = nullptr;   ///< [D x num_arm x 3] metres from the surface point
  int num_directions = 0;               ///< [D]
  int num_arm = 0;                      ///< samples a direction, in the order in which they are tested
  float normal_cos_min = 0;             ///< cos of the cone around the normal
};

/// State of the points on the device, structure of arrays; index = stable id. 60 bytes a point at D = 180.
struct PointStateView {
  float* position_L = nullptr;         ///< [3 n] first return, metres; x y z interleaved
  float* normal_L = nullptr;           ///< [3 n] unit; zero = none
  std::uint64_t* seen = nullptr;       ///< [words n] directions observed from, neighbours joined
  std::uint16_t* score = nullptr;      ///< [n] fewest collisions; kNoScore
  std::uint16_t* direction = nullptr;  ///< [n] best direction; kNoDirection
  float* stability = nullptr;          ///< [n] a
  std::uint16_t* weight = nullptr;     ///< [n] observations behind the confidence
  PointLabel* label = nullptr;         ///< [n]
  PointReason* reason = nullptr;       ///< [n]
  int direction_words = 0;             ///< words of `seen` a point
};

static_assert(std::is_trivially_copyable_v<DirectionMask>);
static_assert(std::is_trivially_copyable_v<OccupancyView>);
static_assert(std::is_trivially_copyable_v<ToolKernelView>);
static_assert(std::is_trivially_copyable_v<ToolCellsView>);
static_assert(std::is_trivially_copyable_v<ApproachView>);
static_assert(std::is_trivially_copyable_v<PointStateView>);

}  // namespace accessvdb::kernels
