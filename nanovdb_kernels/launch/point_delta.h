// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a backend that keeps the points itself is told about them, for any policy: which points and blocks are new or
/// changed, and how confident the map is in them. Also its answers.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "hostdev/point_update.h"
#include "hostdev/surface_choice.h"
#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Blocks are processed in groups: cubes of 2^group_log2 leaves per edge, aligned to multiples of that. Answers about
/// flips hold for all points of a group.
inline constexpr int kMaxGroupLog2 = 3;

/// Constants of neighbourhoods and blocks.
struct NeighbourTables {
  double voxel_size_m = 0;
  double radius_m = 0;      ///< no neighbour is farther away
  int neighbours = 0;       ///< [k]
  int view_neighbours = 0;  ///< this many of the nearest share their seen directions; 0: none
  int num_directions = 0;   ///< [D]
  int group_log2 = 0;       ///< [log2 of leaves] edge of a group of blocks, 0 .. kMaxGroupLog2
  SurfaceChoice choice;     ///< which points are scored
};

/// A point that is new, or that a scan touched since the last update.
struct PointDelta {
  std::uint32_t id = 0, block = 0;
  float position_L[3] = {0, 0, 0};  ///< first return
  float mean_L[3] = {0, 0, 0};      ///< what neighbourhoods are based on
  float before_L[3] = {0, 0, 0};    ///< the mean at the last update; NaN for a new point
  float to_sensor_L[3] = {0, 0, 0};
  DirectionMask seen = {};  ///< the point's own directions
};

/// A leaf of the map with surface points, new or with more points than before.
struct BlockDelta {
  std::uint32_t block = 0;
  std::int32_t leaf[3] = {0, 0, 0};    ///< voxel index >> 3
  std::uint32_t first = 0, count = 0;  ///< its ids are in slots [first, first + count)
  std::uint32_t source = 0;            ///< and start here in AdmitInput::block_ids
  std::uint32_t is_new = 0;
  std::uint32_t group = 0;  ///< if new: number of its group, constant from then on
};

/// Observations behind the confidence in a point.
struct PointWeight {
  std::uint32_t id = 0;
  std::uint16_t weight = 0;
};

/// Points that are new or changed; host memory, reusable on return.
struct AdmitInput {
  /// Per tool, in the backend's memory, with room for num_points. Positions, normals, views and weights are the same
  /// arrays for all tools.
  std::span<const PointStateView> states;
  std::uint32_t num_points = 0, num_blocks = 0, num_groups = 0, num_slots = 0;
  std::span<const PointDelta> deltas;
  std::span<const std::uint32_t> returns;  ///< [deltas] of each point so far; only if a choice is made
  std::span<const BlockDelta> blocks;
  std::span<const std::uint32_t> block_ids;
};

/// What evaluating points for one tool reads. All views are in the backend's memory.
struct ToolInput {
  ToolKernelView tool;
  ToolSlabsView slabs;
  ApproachView approach;
  PointStateView points;
  UpdateRule rule;
};
/// What evaluating points reads.
struct ScoringInput {
  std::span<const ToolInput> tools;  ///< in the order of ExactTables::tools
  OccupancyView map;
  std::uint32_t budget_points = 0;  ///< most points evaluated in this update, per tool; 0: no limit
};

/// What the map says about the points since the last update; host memory, reusable on return.
struct ConfidenceDelta {
  std::span<const PointWeight> weights;  ///< of the admitted points
  std::span<const PointWeight> crossed;  ///< points that became confident enough to be scored; ids differ
};

/// For all tools together.
struct UpdateOutcome {
  std::uint64_t moved = 0;      ///< neighbourhoods computed
  std::uint64_t evaluated = 0;  ///< points examined
  std::uint64_t scored = 0;     ///< those with at least one direction tested
  std::uint64_t tests = 0;      ///< (point, direction) tests
  std::uint64_t label_changes = 0;
  std::uint64_t waiting = 0;          ///< points that are due but were not evaluated
  std::uint64_t waiting_updates = 0;  ///< QueueAge::updates(), of the tool whose points wait longest
  std::uint64_t withheld = 0;         ///< those of them whose stored label is accessible
  double score_ms = 0;                ///< time spent evaluating
  std::vector<std::vector<std::uint32_t>> waiting_ids = {};  ///< which points wait, for each tool
};

/// Admits points, the same way for every policy.
class PointAdmission {
 public:
  virtual ~PointAdmission() = default;
  /// Admits points; no id twice between two updates.
  virtual void admit(const AdmitInput& input) = 0;
  /// Bytes of device memory in use, without the point state.
  [[nodiscard]] virtual std::uint64_t bytes() const = 0;
};

}  // namespace accessvdb::kernels
