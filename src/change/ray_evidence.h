// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the rays of one scan say about surfaces that they pass: which cells they went through, and which voxels of
/// cells that have gone they open. Reads map and points as they are, changes nothing; any order of the rays, and any
/// number of threads, give the same.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "change/cell_record.h"
#include "change/leaf_flags.h"
#include "points/chunked_array.h"
#include "points/point_store.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

/// The cells of a block of points, and what the walk needs to know of them at a glance.
struct BlockCells {
  LeafCells cells;
  std::uint8_t suspect = 0;  ///< one bit per cell: all rays are examined there
  std::uint8_t gone = 0;     ///< one bit per cell: Verdict::Gone or Open
};

/// A pass through a cell: (block * 8 + cell) << 6 | line.
using Pass = std::uint64_t;

struct OpenedLeaf {
  Index3 leaf = {};  ///< voxel index >> 3
  LeafBits voxels = {};
};

struct RayEvidence {
  std::vector<Pass> passes;        ///< ascending, each once
  std::vector<OpenedLeaf> opened;  ///< by place, each leaf once
};

/// What is fixed for a map, in voxels.
struct WalkShape {
  double voxel_size_m = 0;
  double margin = 0;              ///< a ray says nothing about the last part before its return: tau + 3 sigma
  double line_step = 0.125;       ///< two crossings nearer than this are one line
  std::int32_t shadow_cells = 1;  ///< how far behind a surface its voxels may collide, in cells of 4 voxels
};

/// Where to look.
struct WalkPlaces {
  const ChunkedArray<BlockCells>& blocks;  ///< per block of points
  const LeafFlags& suspect;                ///< leaves with a suspect cell; others may be among them
  const LeafFlags& opening;                ///< leaves in which rays may open voxels
};

[[nodiscard]] RayEvidence evidenceOf(const PackedMap& map, const PointStore& points, const WalkShape& shape,
                                     const WalkPlaces& places, std::span<const Eigen::Vector3f> p_L,
                                     std::span<const Eigen::Vector3f> q_L);

/// Finds out whether a voxel of a cell may be opened: its cell has gone, or lies near one that has, and neither itself
/// nor a cell beside it has a point that still collides: the inside of what has gone, and its shadow. For one thread.
class OpenCells {
 public:
  OpenCells(const PackedMap& map, const PointStore& points, const WalkShape& shape, const WalkPlaces& places)
      : map_(map), points_(points), shape_(shape), places_(places) {}
  [[nodiscard]] bool mayOpen(const Index3& cell);
  /// Whether a cell that has gone, and around which something is left to open, is near enough for a leaf's voxels to be
  /// looked at. WalkPlaces::opening may have leaves of which that is no longer so.
  [[nodiscard]] bool isWalked(const Index3& leaf);

 private:
  [[nodiscard]] bool find(const Index3& cell) const;
  [[nodiscard]] bool stands(const Index3& cell) const;
  [[nodiscard]] bool isNearGone(const Index3& leaf) const;

  const PackedMap& map_;
  const PointStore& points_;
  const WalkShape& shape_;
  WalkPlaces places_;
  PlaceMap known_, walked_;  ///< 0: no, 1: yes
};

}  // namespace accessvdb::internal
