// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy run entirely by a backend: which points are due, their neighbourhoods and their scores, all in
/// arrays that stay on the device (docs/DESIGN.md, "Exact updates"; docs/design/gpu.md, "The two backends").
#pragma once

#include <cstdint>
#include <span>

#include "hostdev/freed_corridors.h"
#include "hostdev/known_counts.h"
#include "launch/point_delta.h"

namespace accessvdb::kernels {

/// Leaves at one horizontal offset from the first leaf of a point's group, and the directions that read them, wherever
/// in its group the point is. Of yaw directions, one column per offset. Of any others, one per leaf; those of an offset
/// follow each other upwards without a gap.
struct FootprintColumn {
  std::int32_t dx, dy, z_low, z_high;  ///< [leaves], z inclusive
  DirectionMask directions;
};

/// Directions first, first + 1 .. first + count - 1, modulo D; count 0: none.
struct DirectionArc {
  std::uint8_t first = 0;
  std::uint16_t count = 0;  ///< at most D
};

/// ArcsView in host memory.
struct ArcsTable {
  std::span<const ArcsOfColumn> table;
  std::span<const CoveringArc> more;
  ArcsView shape;  ///< without these
};

/// Constant tables of one tool in host memory, needed only while the updater is created.
struct ToolTables {
  std::span<const FootprintColumn> tool_columns, arm_columns;  ///< for groups of NeighbourTables::group_log2
  bool any_directions = false;                                 ///< they are not all yaws in order
  int arc = 0;  ///< largest number of directions within a point's cone; 0: unknown
  /// The inverse of the tool: [x][y][z] which directions may cover a cell of 4 x 4 x 4 voxels from a point somewhere in
  /// a group. The first entry is for the cell cell_low, in cells from the group's first one. Empty: unknown, and
  /// collisions are not remembered.
  std::span<const DirectionArc> cell_directions;
  std::span<const DirectionMask> cell_sets;  ///< in place of it, with any_directions
  std::int32_t cell_low[3] = {0, 0, 0}, cell_size[3] = {0, 0, 0};
  /// [x][y] CorridorView::table, for corridors at the height of their point. Empty: corridors that may have become free
  /// are named for a group at a time.
  std::span<const DirectionMask> corridors;
  std::int32_t corridor_reach = 0;  ///< [voxels]
  ArcsTable arcs;                   ///< empty: bounds of collisions do not follow flips, but age
};
/// The tables of tools that are tried in the same directions. Points, their neighbourhoods, normals and views, and what
/// changed are kept once for all of them.
struct ExactTables {
  std::span<const ToolTables> tools;  ///< at least one
  NeighbourTables neighbours;
};

/// A leaf in which facts flipped.
struct LeafFlips {
  static constexpr std::uint32_t kManyFreed = 255;
  std::int32_t leaf[3] = {0, 0, 0};
  std::uint16_t kinds = 0;  ///< bit 0 collides on, 1 collides off, 2 arm free on, 3 arm free off
  /// ColumnsForArm::heights and columns, of voxels that became free for a corridor, and of those that ceased to be.
  std::uint8_t freed_heights = 0, blocked_heights = 0;
  std::uint64_t freed = 0;  ///< voxels that stopped colliding, one byte per cell as in countCells(); 255: or more
  std::uint64_t freed_columns = 0, blocked_columns = 0;
  std::uint32_t first_voxel = 0, voxels = 0;  ///< of FlipLists::voxels
};

/// A voxel that began or ceased to collide.
namespace flipped_voxel {

/// @param place  64 x + 8 y + z in its leaf
ACCESSVDB_HOSTDEV inline std::uint16_t codeOf(int place, bool collides) {
  return static_cast<std::uint16_t>(place << 1 | (collides ? 1 : 0));
}

}  // namespace flipped_voxel

/// What flipped, in the memory of the backend. Complete once the mirror is.
struct FlipsOnDevice {
  const LeafFlips* leaves = nullptr;  ///< a leaf may come several times
  std::uint32_t count = 0;
  const std::uint16_t* voxels = nullptr;  ///< flipped_voxel::codeOf()
  std::uint32_t voxel_count = 0;
};

/// Lists of flips; a leaf may be in several.
struct FlipLists {
  std::span<const std::span<const LeafFlips>> leaves;
  /// flipped_voxel::codeOf() of all voxels, in as many lists; the leaves count through all of them. Empty if no tool
  /// has arcs.
  std::span<const std::span<const std::uint16_t>> voxels;
  FlipsOnDevice on_device = {};  ///< if it has any, the lists are empty
};

/// An update is any number of admit() and begin(), in any order, then choose(), then update(). findNeighbours() may be
/// called once everything is admitted.
class ExactUpdater : public PointAdmission {
 public:
  /// After findNeighbours() it starts over: everything admitted since the last update has to be admitted again.
  void admit(const AdmitInput& input) override = 0;
  /// Starts finding the neighbourhoods of the admitted points and returns while the backend is still working. They do
  /// not depend on the map. If not called, update() finds them.
  virtual void findNeighbours() = 0;
  /// Whether flips have to name each voxel that began or ceased to collide.
  [[nodiscard]] virtual bool takesVoxels() const = 0;
  /// Takes the flips and returns while the backend is still working on them. Does not read the map. May be called again
  /// before update(), with all flips since the last one.
  virtual void begin(const ScoringInput& input, const FlipLists& flips) = 0;
  /// Starts on what is due at the points that were confident at the last update, and returns while the backend is still
  /// working on it.
  virtual void choose(const ScoringInput& input) = 0;
  /// Brings neighbourhoods, labels, directions and scores up to date with the map and the admitted points.
  virtual UpdateOutcome update(const ScoringInput& input, const ConfidenceDelta& confidence) = 0;
};

}  // namespace accessvdb::kernels
