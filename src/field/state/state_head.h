// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The first section of a saved state: which program, rules, tool and parameters made it, and how much follows.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/params.h"

namespace accessvdb::internal {

/// Layout of the file. Raise it when a section changes: isStateSchema() says which numbers this program reads.
inline constexpr std::uint32_t kStateSchema = 6;
/// The same with a set of orientations behind the parameters: of fields whose tool does not only turn in yaw.
inline constexpr std::uint32_t kOrientedStateSchema = 7;
/// The same with the number of rolls behind the orientations: of fields whose tool rolls.
inline constexpr std::uint32_t kRolledStateSchema = 8;
/// Added to any of them for ChangeMode::Full, whose states hold more.
inline constexpr std::uint32_t kFullChangeSchema = 10;
/// Added to any of these for states with what an update found out.
inline constexpr std::uint32_t kScoredSchema = 20;
/// Added to any of these for fields whose returns carry attributes, whose states hold these, too.
inline constexpr std::uint32_t kCarryingSchema = 40;
/// Added to any of these for fields that score one point of each cell, whose states hold its edge, too.
inline constexpr std::uint32_t kSpacedSchema = 80;
/// Added to any of these where leaves have observed voxels only, as all that this program writes. Others have all.
inline constexpr std::uint32_t kCompactSchema = 160;

[[nodiscard]] constexpr bool isCompactSchema(std::uint32_t schema) { return schema > kCompactSchema; }
[[nodiscard]] constexpr std::uint32_t uncompactSchema(std::uint32_t schema) {
  return schema - (isCompactSchema(schema) ? kCompactSchema : 0);
}
[[nodiscard]] constexpr bool isSpacedSchema(std::uint32_t schema) { return uncompactSchema(schema) > kSpacedSchema; }
[[nodiscard]] constexpr std::uint32_t unspacedSchema(std::uint32_t schema) {
  return uncompactSchema(schema) - (isSpacedSchema(schema) ? kSpacedSchema : 0);
}
[[nodiscard]] constexpr bool isCarryingSchema(std::uint32_t schema) { return unspacedSchema(schema) > kCarryingSchema; }
[[nodiscard]] constexpr std::uint32_t uncarryingSchema(std::uint32_t schema) {
  return unspacedSchema(schema) - (isCarryingSchema(schema) ? kCarryingSchema : 0);
}
[[nodiscard]] constexpr bool isScoredSchema(std::uint32_t schema) { return uncarryingSchema(schema) > kScoredSchema; }
[[nodiscard]] constexpr std::uint32_t unscoredSchema(std::uint32_t schema) {
  return uncarryingSchema(schema) - (isScoredSchema(schema) ? kScoredSchema : 0);
}
[[nodiscard]] constexpr bool isFullChangeSchema(std::uint32_t schema) {
  return unscoredSchema(schema) > kFullChangeSchema;
}
[[nodiscard]] constexpr std::uint32_t plainSchema(std::uint32_t schema) {
  return unscoredSchema(schema) - (isFullChangeSchema(schema) ? kFullChangeSchema : 0);
}
[[nodiscard]] constexpr bool isStateSchema(std::uint32_t schema) {
  const std::uint32_t plain = plainSchema(schema);
  return plain == kStateSchema || plain == kOrientedStateSchema || plain == kRolledStateSchema;
}
/// Of states that this program writes.
/// @param params  of a field, where the number of rolls is known  @param scored  StateHead::isScored()
[[nodiscard]] inline std::uint32_t stateSchemaOf(const FieldParams& params, bool scored) {
  const std::uint32_t more = kCompactSchema + (params.change.mode == ChangeMode::Full ? kFullChangeSchema : 0) +
                             (params.carry.empty() ? 0 : kCarryingSchema) + (scored ? kScoredSchema : 0) +
                             (params.scoring.point_spacing_m > 0 ? kSpacedSchema : 0);
  if (params.approach.rolls > 1) return kRolledStateSchema + more;
  return (params.approach.orientations.isYaw() ? kStateSchema : kOrientedStateSchema) + more;
}

/// One of several tools.
struct SavedTool {
  std::string name, sha256;  ///< ToolSpec::name, ToolGeometry::sha256()
  std::string orientations;  ///< OrientationSet::text()
  std::int32_t rolls = 0, max_collisions = 0;
  std::uint32_t view_words = 0;  ///< of seen directions that are stored for it; 0: they are an earlier tool's
};
/// What a list of several tools is called in place of a tool's hash (toolListSha256).
inline constexpr const char* kToolListMark = "tools:";

struct StateHead {
  std::uint32_t schema = kStateSchema;
  std::uint32_t rules_version = 0;
  std::string version;                      ///< of the program, for people
  std::string tool_sha256;                  ///< ToolGeometry::sha256(), or toolListSha256()
  std::vector<SavedTool> tools;             ///< of a list
  FieldParams params;                       ///< resolved, without what says where a field runs
  std::optional<Eigen::Vector3d> origin_W;  ///< once there is one
  bool updated = false;                     ///< after an update(): its labels have to be made again
  std::uint64_t scans = 0;                  ///< integrated
  std::optional<double> latest_stamp_s;     ///< of all scans; nothing while none had one
  std::uint64_t leaves = 0, leaves_with_values = 0, leaves_with_votes = 0;
  std::uint64_t voxel_bytes = 0;  ///< of all leaves
  std::uint64_t points = 0, poses = 0;
  std::uint64_t split_points = 0, votes = 0;  ///< PointAttributes, over all columns; only where returns carry some
  std::uint64_t left_out_leaves = 0;          ///< LeftOutVoxels
  std::uint64_t closed_cubes = 0;             ///< LeftOutPoints
  std::uint32_t closed_doublings = 0;
  // Only for ChangeMode::Full.
  double age_s = 0;  ///< FreeGenerations::age_s()
  std::uint64_t leaves_with_before = 0;
  std::uint64_t gone_scans = 0;                    ///< GoneCells::scans()
  std::uint64_t cell_blocks = 0, gone_points = 0;  ///< leaves with cells; points with something in GonePoints
  /// Of seen directions, of all tools, that are stored with what an update found out; 0 if that is not stored.
  std::uint32_t scored_words = 0;

  [[nodiscard]] bool isScored() const { return scored_words > 0; }
  [[nodiscard]] std::size_t toolCount() const { return tools.empty() ? 1 : tools.size(); }
};

/// Of the seen directions of one point that are stored for further tools.
[[nodiscard]] std::uint64_t viewBytesPerPoint(const StateHead& head);

[[nodiscard]] std::vector<char> bytesOf(const StateHead& head);

/// @return nothing if the bytes are not such a head: too few, too many, or with values that no field has. Of another
///         schema or other rules, only the first four members are read.
[[nodiscard]] std::optional<StateHead> headFrom(const std::vector<char>& bytes);

}  // namespace accessvdb::internal
