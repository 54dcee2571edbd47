// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes the state of a field into one file (docs/design/state.md, "Saved state").
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "change/gone_cells.h"
#include "change/gone_points.h"
#include "field/left_out_points.h"
#include "field/state/state_head.h"
#include "io/streams/whole_file.h"
#include "points/point_store.h"
#include "tsdf/leaf_values.h"
#include "tsdf/packed_map.h"
#include "update/point_scorer.h"

namespace accessvdb::internal {

/// Leaves are at multiples of 8 voxels within this, so that a mirror can hold them.
inline constexpr std::int32_t kFarthestLeaf_voxels = 1 << 21;

/// Bytes of a leaf, of its values without the voxels, its votes, and what was free there before if it has any, of a
/// point, and of a sensor position.
inline constexpr std::uint64_t kLeafBytes = 3 * sizeof(std::int32_t) + sizeof(std::uint32_t) + sizeof(LeafBits);
inline constexpr std::uint64_t kLeafValuesBytes = sizeof(CompactLeaf::observed) + 2 * sizeof(std::uint32_t);
inline constexpr std::uint64_t kPlainValuesBytes = PackedLeaf::SIZE * sizeof(std::uint32_t);  ///< before they were so
inline constexpr std::uint64_t kLeafVoteBytes = sizeof(VoxelVotes::bit);
inline constexpr std::uint64_t kLeafBeforeBytes = sizeof(LeafBits);
inline constexpr std::uint32_t kHasValues = 1, kHasVotes = 2, kHasBefore = 4;  ///< flags of a leaf
/// Calls visit(data, bytes) for all that a state holds of values before their voxels, in its order.
template <typename Head, typename Visit>
void visitValues(Head& head, const Visit& visit) {
  visit(head.observed, sizeof head.observed);
  visit(&head.base_weight, sizeof head.base_weight);
  visit(&head.voxel_bytes, sizeof head.voxel_bytes);
}
/// Bytes of the section.
[[nodiscard]] std::uint64_t leavesBytes(const StateHead& head);
inline constexpr std::uint64_t kPoseBytes = 3 * sizeof(float);
[[nodiscard]] std::uint64_t storedPointBytes(const FieldParams& params);
/// Calls visit(data, bytes) for all that a state holds of a point, in its order.
/// @param words  its seen directions; empty with viewpoints
template <typename Point, typename Words, typename Visit>
void visitStoredPoint(Point& point, Words words, const Visit& visit) {
  visit(point.first_L.data(), 3 * sizeof(float));
  visit(point.sums.offset.data(), sizeof point.sums.offset);
  visit(point.sums.sensor.data(), sizeof point.sums.sensor);
  visit(&point.sums.returns, sizeof point.sums.returns);
  if (!words.empty()) return visit(words.data(), words.size_bytes());
  visit(&point.seen.views.count, sizeof point.seen.views.count);
  visit(point.seen.views.pose.data(), sizeof point.seen.views.pose);
}

/// Of ChangeMode::Full: a leaf's cells, and a point of GonePoints.
inline constexpr std::uint64_t kLeafCellBytes = 3 * sizeof(std::int32_t) + sizeof(LeafCells);
/// Calls visit(part) for all that a state holds of a cell, in its order. One by one: what lies between the parts of a
/// CellRecord is not defined. @param verdict  std::uint16_t in place of the cell's own
template <typename Cell, typename Number, typename Visit>
void visitStored(Cell& cell, Number& verdict, const Visit& visit) {
  visit(cell.lines);
  visit(cell.hits);
  visit(cell.missed);
  visit(cell.emptied);
  visit(cell.followed);
  visit(cell.scans);
  visit(verdict);
}
inline constexpr std::uint64_t kGonePointBytes = 2 * sizeof(std::uint32_t);
/// Of each column of a split point: its id, the column and how many votes follow; and of a vote.
inline constexpr std::uint64_t kSplitPointBytes = 3 * sizeof(std::uint32_t);
inline constexpr std::uint64_t kVoteBytes = sizeof(PointAttributes::Vote);
/// Of what was left out: a leaf's voxels, and a closed cube.
inline constexpr std::uint64_t kLeftOutLeafBytes = 3 * sizeof(std::int32_t) + sizeof(LeafBits);
inline constexpr std::uint64_t kClosedCubeBytes = sizeof(LeftOutPoints::Cube);
/// Bytes of all sections for ChangeMode::Full, with their frames; 0 for other modes.
[[nodiscard]] std::uint64_t goneStateBytes(const StateHead& head);

/// What an update found out about a point, for one tool, without seen directions.
inline constexpr std::uint64_t kScoredPointBytes = 30;
/// Calls visit(part) for all of it, in its order.
template <typename Point, typename Visit>
void visitScored(Point& point, const Visit& visit) {
  for (Eigen::Index axis = 0; axis < 3; ++axis) visit(point.normal_L[axis]);
  visit(point.reach_m);
  visit(point.stability);
  visit(point.weight);
  visit(point.score);
  visit(point.direction);
  visit(point.label);
  visit(point.reason);
  visit(point.roll);
  visit(point.has_neighbourhood);
}
/// Bytes of the section, with its frame; 0 if there is none.
[[nodiscard]] std::uint64_t scoredStateBytes(const StateHead& head);

/// Evidence about what has gone.
struct GoneState {
  const GoneCells* cells;
  const GonePoints* points;
};

/// @throws InvalidArgument "usage.checkpoint"  for fields whose results depend on more than a state holds
void requireSavable(const FieldParams& params);

/// What a state is made of.
struct StateInputs {
  const PackedMap& map;
  std::vector<PointStore*> stores;  ///< of the tools: the same points, seen from other directions
  std::optional<GoneState> gone;    ///< only for ChangeMode::Full
  const LeftOutPoints& left_out;
  std::vector<const PointScorer*> scorers;  ///< of the tools, if their labels are up to date and all on the host
};

/// @param head  its counts of leaves and points are filled in here
/// @param write  makes the file  @throws OutputError
void writeState(const std::filesystem::path& file, StateHead head, const StateInputs& parts, io::WriteFile write);

}  // namespace accessvdb::internal
