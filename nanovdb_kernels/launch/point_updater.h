// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// An update policy as a backend runs it by itself: which points are due, their neighbourhoods, their scores, all on
/// arrays that stay on the device (docs/DESIGN.md, "Exact updates", "The two backends").
#pragma once

#include <cstdint>
#include <span>

#include "hostdev/paper_rule.h"
#include "hostdev/point_update.h"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Blocks are looked at in groups: cubes of 2^group_log2 leaves an edge, aligned to multiples of that. What is asked of
/// flips holds for all points of a group.
inline constexpr int kMostGroupLog2 = 3;

/// Leaves at one horizontal offset from the first leaf of a point's group, and the directions that read them wherever
/// in its group the point lies. One an offset.
struct FootprintColumn {
  std::int32_t dx, dy, z_low, z_high;  ///< [leaves], z inclusive
  DirectionMask directions;
};

/// Directions first, first + 1 .. first + count - 1, modulo D; count 0: none.
struct DirectionArc {
  std::uint8_t first = 0;
  std::uint16_t count = 0;  ///< at most D
};

/// What never changes. Host memory, needed only while the updater is made.
struct UpdaterTables {
  double voxel_size_m = 0;
  double radius_m = 0;      ///< no neighbour is farther away
  int neighbours = 0;       ///< [k]
  int view_neighbours = 0;  ///< the nearest this many share their seen directions; 0: none does
  int num_directions = 0;   ///< [D]
  int group_log2 = 0;       ///< [log2 of leaves] edge of a group of blocks, 0 .. kMostGroupLog2; the columns are for it
  // Only for the exact policy.
  std::span<const FootprintColumn> tool_columns, arm_columns;
  /// The tool read backwards: [x][y][z] which directions may cover a cell of 4 x 4 x 4 voxels from a point somewhere in
  /// a group; the first entry is that of the cell cell_low, in cells from the group's first one. Empty: not known, then
  /// collisions are not remembered.
  std::span<const DirectionArc> cell_directions;
  std::int32_t cell_low[3] = {0, 0, 0}, cell_size[3] = {0, 0, 0};
  // Only for the paper's policy.
  bool paper_policy = false;
  CoarseToFine candidates;
};

/// A point that is new, or that a scan touched since the last update.
struct PointNews {
  std::uint32_t id = 0, block = 0;
  float position_L[3] = {0, 0, 0};  ///< first return
  float mean_L[3] = {0, 0, 0};      ///< what neighbourhoods are made of
  float before_L[3] = {0, 0, 0};    ///< the mean at the last update; NaN where the point is new
  float to_sensor_L[3] = {0, 0, 0};
  DirectionMask seen = {};  ///< the point's own directions
};

/// A leaf of the map with surface points, new or with more points than before.
struct BlockNews {
  std::uint32_t block = 0;
  std::int32_t leaf[3] = {0, 0, 0};    ///< voxel index >> 3
  std::uint32_t first = 0, count = 0;  ///< its ids lie in slots [first, first + count)
  std::uint32_t source = 0;            ///< and in AdmitInput::block_ids from here on
  std::uint32_t is_new = 0;
  std::uint32_t group = 0;  ///< where it is new: number of its group, from then on
};

/// A leaf in which facts flipped: bit 0 collides on, 1 collides off, 2 arm free on, 3 arm free off.
struct LeafFlips {
  static constexpr std::uint32_t kManyFreed = 255;
  std::int32_t leaf[3] = {0, 0, 0};
  std::uint32_t kinds = 0;
  std::uint64_t freed = 0;  ///< voxels that ceased to collide, a byte a cell as countCells() has them; 255: or more
};

/// Observations behind the confidence of a point.
struct PointWeight {
  std::uint32_t id = 0;
  std::uint16_t weight = 0;
};

/// Points that are new or changed; host memory, free again on return.
struct AdmitInput {
  PointStateView points;  ///< in the backend's memory, room for num_points
  std::uint32_t num_points = 0, num_blocks = 0, num_groups = 0, num_slots = 0;
  std::span<const PointNews> news;
  std::span<const BlockNews> blocks;
  std::span<const std::uint32_t> block_ids;
};

/// What is needed beside the points; host memory, free again on return.
struct UpdateInput {
  OccupancyView map;
  ToolKernelView tool;    ///< in the backend's memory
  ToolSlabsView slabs;    ///< in the backend's memory
  ApproachView approach;  ///< in the backend's memory
  PointStateView points;  ///< in the backend's memory
  UpdateRule rule;
  std::span<const PointWeight> weights;               ///< of the points that were admitted
  std::span<const PointWeight> crossed;               ///< points that became confident enough to be scored; ids differ
  std::span<const std::span<const LeafFlips>> flips;  ///< since the last update; a leaf may come several times
  std::uint32_t budget_points = 0;                    ///< most points evaluated, always the same; 0: no limit
  // Only for the paper's policy: what its triggers asked for, ids ascending. Points that are not confident may be among
  // them.
  std::span<const std::uint32_t> jumped, sampled;
  bool all_blocked = false;  ///< every point that is not accessible
};

struct UpdateOutcome {
  std::uint64_t moved = 0;      ///< neighbourhoods computed
  std::uint64_t evaluated = 0;  ///< points looked at
  std::uint64_t scored = 0;     ///< of them, points with at least one direction tested
  std::uint64_t tests = 0;      ///< (point, direction) tests
  std::uint64_t label_changes = 0;
  std::uint64_t waiting = 0;  ///< points that are due and were not evaluated
  double score_ms = 0;        ///< evaluating what is due
};

/// An update is any number of admit(), and begin(), in any order, then choose(), and then update(). findNeighbours()
/// may come once all is admitted.
class PointUpdater {
 public:
  virtual ~PointUpdater() = default;
  /// Takes points in; no id twice between two updates. After findNeighbours() it begins anew: what was admitted since
  /// the last update has to come again.
  virtual void admit(const AdmitInput& input) = 0;
  /// Begins with the neighbourhoods of what was admitted, and returns while the backend is still at work on them. They
  /// need nothing of the map. Without it, update() finds them.
  virtual void findNeighbours() = 0;
  /// The exact policy takes the flips in and returns while the backend is still at work on them. Neither weights nor
  /// the map are looked at. May come again before update(), with all flips since the last one.
  virtual void begin(const UpdateInput& input) = 0;
  /// Begins with what is due of the points that were confident at the last update, and returns while the backend is
  /// still at work on it: neither weights nor crossed are looked at.
  /// @param input  as update() will get it
  virtual void choose(const UpdateInput& input) = 0;
  /// Brings neighbourhoods, labels, directions and scores up to date with the map and with what was admitted.
  /// @param input  as at begin(), with weights; its flips are not looked at again
  virtual UpdateOutcome update(const UpdateInput& input) = 0;
  /// Bytes of device memory that it holds, the point state not included.
  [[nodiscard]] virtual std::uint64_t bytes() const = 0;
};

}  // namespace accessvdb::kernels
