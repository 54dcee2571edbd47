// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// From labels to what a machine can do next: which points to go to, in which order, and how.
///
///   for (const accessvdb::ApproachTarget& target : accessvdb::approaches(field, {.most = 10}))
///     plan(target.approaches.front().pre_contact_T_WT);
///
/// Targets are accessible points, spread over the surface. An approach is a way in along the tool's body: from the
/// pre-contact pose straight to contact, and back to the retreat pose. The way to contact was seen to be free, as
/// PoseQuery::fits() judges, from where the tool no longer touches what it works on; nearer, nothing collides as where
/// the field scores a point (FitOptions::contact), which takes unknown space for free.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

class AccessibilityField;

struct ApproachOptions {
  std::size_t most = 10;  ///< targets; with `per`, for each value; 0: all
  double spacing_m = 0;   ///< least distance between two targets; 0 = rule: 0.25 m, at least 5 voxels
  std::size_t each = 3;   ///< most approaches of a target; at least 1
  /// How far before contact the pre-contact pose is, along the tool's body; the retreat pose is up to twice as far.
  /// 0 = rule: 0.3 m, at least 8 voxels.
  double stand_off_m = 0;
  /// Where the machine is, world frame: of targets that are otherwise alike, the nearer one comes first.
  std::optional<Eigen::Vector3d> from_W = std::nullopt;
  double within_m = std::numeric_limits<double>::infinity();  ///< of from_W
  std::string per = {};        ///< a name of FieldParams::carry: targets are ranked for each of its values
  bool allow_unknown = false;  ///< ways may lead through space that nothing is known of
};

/// One way in.
struct ApproachPath {
  Eigen::Isometry3d pre_contact_T_WT = Eigen::Isometry3d::Identity();  ///< world from tool
  Eigen::Isometry3d contact_T_WT = Eigen::Isometry3d::Identity();      ///< the tip is at the point
  Eigen::Isometry3d retreat_T_WT = Eigen::Isometry3d::Identity();
  std::uint16_t direction = 0;  ///< as SurfacePoint::direction; the first one's has most free directions around it
  std::uint8_t roll = 0;        ///< as SurfacePoint::roll
  // With the room that the target's margin says:
  std::uint16_t collisions = 0;  ///< in contact, below the field's limit
  float free_arc_deg = -1;       ///< as AccessibilityField::freeArcs_deg(), around this direction
  /// How far back from contact the way was seen free, up to twice the stand-off; with ApproachOptions::allow_unknown,
  /// how far nothing is known to be in it.
  double seen_free_m = 0;
};

struct ApproachTarget {
  std::uint32_t point = 0;  ///< SurfacePoint::id
  Eigen::Vector3d position_W = {0, 0, 0};
  Eigen::Vector3f normal_W = {0, 0, 0};
  std::size_t tool = 0;           ///< of the field's tools
  float margin_m = -1;            ///< SurfacePoint::margin_m; all of its approaches have that much room in contact
  float confidence = 0;           ///< SurfacePoint::confidence
  float access_probability = -1;  ///< SurfacePoint::access_probability; nothing is ranked by it
  double distance_m = 0;          ///< from ApproachOptions::from_W; 0 without it
  std::size_t covers = 0;         ///< accessible points that are nearer to it than the spacing
  std::int32_t value = 0;         ///< of the attribute `per`
  std::vector<ApproachPath> approaches;  ///< at least one
  std::string why;                       ///< what it was ranked by, in words
};

/// What was found, and what was not.
struct Approaches {
  std::vector<ApproachTarget> targets;  ///< best first; with `per` by value, then best first
  std::uint64_t accessible = 0;         ///< points that were considered
  std::uint64_t covered = 0;            ///< of them, those nearer to a target than the spacing
  std::uint64_t without_way = 0;  ///< tried in vain: no way to them was seen free, or something is in it near contact
};

/// Ranked by room (margin_m, where the field has margins), then how far the tool can turn (in steps of 10 degrees), how
/// sure the point is (confidence, in tenths), how near it is (in steps of half a metre, where from_W is given), and how
/// high (in such steps, the highest first); then by id. The same field gives the same list, on any backend.
/// @throws InvalidArgument "approaches.options", "approaches.per"; UnusableInput "approaches.none" (no point is
/// accessible); ResourceLimit "tool.span"
[[nodiscard]] ACCESSVDB_API Approaches approaches(const AccessibilityField& field, const ApproachOptions& options = {});

namespace io {

/// approaches.json, approaches.csv (one row per approach) and approaches.ply (an arrow for each, ending at its point).
/// @param tools  their names  @throws OutputError
ACCESSVDB_API void writeApproaches(const std::filesystem::path& folder, const Approaches& found,
                                   const std::vector<std::string>& tools);
/// The content of approaches.json.
[[nodiscard]] ACCESSVDB_API std::string approachesJson(const Approaches& found, const std::vector<std::string>& tools);

}  // namespace io
}  // namespace accessvdb
