// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the rules read: trivially copyable, non-owning views that are passed to kernels by value.
///
/// Frame L: the local frame, world minus the recorded origin, metres, float32. Voxel of p_L: round(p_L / v), on
/// faces see position_voxel.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "accessvdb/point_label.h"
#include "direction_mask.h"
#include "nanovdb_compat.h"

namespace accessvdb::kernels {

/// The map as needed for scoring: value bit = collides, active bit = arm_free. A missing leaf means: tool free, arm
/// blocked.
struct OccupancyView {
  const OccupancyGrid* grid = nullptr;
  float inverse_voxel_size = 0;  ///< [1/m]
};

/// A vertical run of up to 64 tool voxels relative to the voxel of the surface point: bit i = (dx, dy, dz + i).
/// Most neighbours in a direction's list are also neighbours in the map.
struct VoxelColumn {
  std::int16_t dx, dy, dz, unused;
  std::uint64_t bits;
};
static_assert(sizeof(VoxelColumn) == 16);

/// Stacked leaves of the map that the tool touches, from the corner of a direction's SlabBox. One more leaf than slabs
/// may be touched: slabs are counted upwards from the point's voxel, which may be anywhere in its leaf.
struct alignas(8) LeafColumn {
  std::uint16_t x = 0;        ///< [voxels] of the leaves' first x, plus 8: they may begin before the box
  std::uint8_t y = 0, z = 0;  ///< [leaves], [slabs]
  std::uint8_t count = 0;     ///< slabs
  std::uint8_t full = 0;      ///< first of a run of slabs, counted from z, that are full for all eight x of the leaf
  std::uint8_t num_full = 0;  ///< of that run; 0 if there is none. Only used if ToolSlabsView::thick
  std::uint8_t unused = 0;
};
static_assert(sizeof(LeafColumn) == 8);
/// A box of slabs of the tool. Each has one x, the eight y of a leaf, eight z; bit 8 y + z. x in voxels, y in leaves, z
/// in slabs from the point. If slabs are not kept by row, that at (x, y, z) is words[first + n],
/// n = ((y - leaf_dy) size_x + x - dx) (size_z + 1) + z - slab_dz, and an empty slab before the first and behind each
/// row is there to be read.
struct alignas(16) SlabBox {
  std::uint32_t first = 0;
  std::int16_t dx = 0, leaf_dy = 0, slab_dz = 0, size_x = 0, size_y = 0, size_z = 0;
};
static_assert(sizeof(SlabBox) == 16);
/// The slabs of a SlabBox at one x and y, from the lowest that is not empty to the highest. Tools that roll have so
/// many boxes, and tools in small voxels such large ones, most of them empty, that their slabs are kept by row: the row
/// at (x, y) is rows[first + (y - leaf_dy) size_x + x - dx], its slab at z is words[row.first + z - slab_dz -
/// row.begin].
struct alignas(8) SlabRow {
  std::uint32_t first = 0;
  std::uint16_t begin = 0, count = 0;
};
static_assert(sizeof(SlabRow) == 8);

/// Box of voxels relative to the voxel of the surface point, inclusive. low > high: unknown.
struct VoxelBox {
  std::int32_t low[3] = {1, 1, 1}, high[3] = {0, 0, 0};
};

/// The tool in every direction d, tip at the origin, self-exclusion already applied.
///
/// A tool that may roll about its body has P = 1 + number of rolls parts per direction, d P .. d P + P - 1: first its
/// core, the voxels that all rolls share (none of samples), then what each roll has besides. All parts of a direction
/// together are the union of its rolls. Otherwise P = 1: a part is a direction.
struct ToolKernelView {
  const VoxelColumn* columns = nullptr;         ///< voxel form: columns of part p: [column_begin[p], column_begin[p+1])
  const std::uint32_t* column_begin = nullptr;  ///< [D P + 1]
  const float* samples = nullptr;               ///< sample form: 3 floats per sample, metres, rotated to the part
  const std::uint32_t* sample_begin = nullptr;  ///< [D P + 1]
  bool use_samples = false;
  std::uint16_t collision_limit = 1;  ///< [n_c] a direction is free if its count is below this
  VoxelBox reach = {};                ///< contains every voxel of every direction
  int parts = 1;                      ///< [P] per direction

  [[nodiscard]] ACCESSVDB_HOSTDEV int rolls() const { return parts == 1 ? 1 : parts - 1; }
};

/// A second copy of the tool's voxel form, to compare 64 of its voxels with 64 of a map leaf at a time. x, y: position
/// of the point's voxel in its leaf. Parts of a tool that rolls take the place of directions. All null if unavailable.
struct ToolSlabsView {
  const std::uint64_t* words = nullptr;
  const SlabBox* boxes = nullptr;        ///< [D x 8]: direction d, y
  const LeafColumn* columns = nullptr;   ///< those with full slabs first; within both kinds, near ones first
  const std::uint32_t* begin = nullptr;  ///< [D x 8 x 8 + 1]: columns of direction d, x, y
  const SlabRow* rows = nullptr;         ///< if slabs are kept by row; else null
  bool thick = false;                    ///< so many slabs are full that looking for them pays off
};

/// Directions and the corridor: tables computed once on the host.
struct ApproachView {
  const float* direction_xy = nullptr;  ///< [2 D] cos and sin of yaw 2 pi d / D; not read if there are axes
  const float* arm_offsets = nullptr;   ///< [D x num_arm x 3] metres from the surface point
  int num_directions = 0;               ///< [D]
  int num_arm = 0;                      ///< samples per direction, in test order
  float normal_cos_min = 0;             ///< cos of the cone around the normal
  /// [3 D] unit, x y z: directions of any kind, in any order. Null: level ones, evenly spread in yaw.
  const float* axes_xyz = nullptr;
};

/// State of the points on the device, structure of arrays; index = stable id. 60 bytes per point at D = 180.
struct PointStateView {
  float* position_L = nullptr;         ///< [3 n] first return, metres; x y z interleaved
  float* normal_L = nullptr;           ///< [3 n] unit; zero = none
  std::uint64_t* seen = nullptr;       ///< [words n] directions observed from, including the neighbours'
  std::uint16_t* score = nullptr;      ///< [n] fewest collisions; kNoScore
  std::uint16_t* direction = nullptr;  ///< [n] best direction; kNoDirection
  float* stability = nullptr;          ///< [n] a
  std::uint16_t* weight = nullptr;     ///< [n] observations behind the confidence
  PointLabel* label = nullptr;         ///< [n]
  PointReason* reason = nullptr;       ///< [n]
  int direction_words = 0;             ///< words of `seen` per point
  std::uint8_t* roll = nullptr;        ///< [n] best roll in the best direction; null: the tool does not roll

  [[nodiscard]] ACCESSVDB_HOSTDEV int rollOf(std::uint32_t id) const { return roll != nullptr ? roll[id] : 0; }
};

static_assert(std::is_trivially_copyable_v<OccupancyView>);
static_assert(std::is_trivially_copyable_v<ToolKernelView>);
static_assert(std::is_trivially_copyable_v<ToolSlabsView>);
static_assert(std::is_trivially_copyable_v<ApproachView>);
static_assert(std::is_trivially_copyable_v<PointStateView>);

}  // namespace accessvdb::kernels
