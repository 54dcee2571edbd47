// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batched queries to a live field, on the host: at points, or along the links of a robot arm.
///
///   const accessvdb::BatchQuery query = field.batchQuery();
///   query.at(points_W, answers);            // millions per second, see docs/developers.md
///   query.along(capsules, path_answers);
///
/// Positions are world coordinates in double precision, converted to the map's local frame internally, so large
/// coordinates (UTM) lose nothing. Bad data are never free: a position that is NaN, infinite or has no voxel is
/// unknown.
///
/// Threads  Any number of threads may use one BatchQuery, or copies of it, at the same time. Each call uses the field's
///          threads; answers do not depend on their number.
/// Validity Until the field's next integrateScan(), integrateRays() or update(), or until it is destroyed: after that,
///          every call throws InvalidArgument "query.stale". None of these calls may run concurrently with a query.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/export.h"
#include "accessvdb/point_label.h"

namespace accessvdb {

namespace internal {
class FieldViews;
}

/// The id that means "no point".
inline constexpr std::uint32_t kNoPoint = ~std::uint32_t{0};
/// Distance within which a surface point answers for a position whose own voxel has no point, in voxels.
inline constexpr int kPointRadiusVoxels = 3;

/// What the map and the points say at a position.
struct PointAnswer {
  /// The voxel's mean of the clamped distances, 0 .. tau metres. NaN where unobserved.
  float distance_m = std::numeric_limits<float>::quiet_NaN();
  /// Distance from the position to the surface point that answers. NaN without one.
  float point_distance_m = std::numeric_limits<float>::quiet_NaN();
  /// That point's best direction: unit, outwards along the tool's body; zero if none.
  Eigen::Vector3f direction_W = {0, 0, 0};
  /// The surface point of the position's voxel; if it has none, the nearest within kPointRadiusVoxels voxels (among
  /// equally near ones, that of the highest voxel); else kNoPoint. `accessvdb query` follows the same rule.
  std::uint32_t point_id = kNoPoint;
  std::uint16_t weight = 0;  ///< observations of the voxel; 0 = unobserved
  std::uint16_t direction = kNoDirection;
  std::uint16_t score = kNoScore;  ///< fewest collisions of any direction
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  bool unknown = true;   ///< the voxel was neither observed nor cleared, or the position is bad
  bool cleared = false;  ///< a ray passed the voxel on its way to a return
};

/// A link of a robot arm, or the path it sweeps: all positions within a radius of a segment.
struct CapsuleQuery {
  Eigen::Vector3d a_W = {0, 0, 0}, b_W = {0, 0, 0};  ///< ends of the axis; may be the same
  double radius_m = 0;                               ///< >= 0
};

/// What a capsule meets. Every voxel is examined whose centre is within radius + half a voxel's diagonal of the axis,
/// so no voxel that the capsule enters is missed.
struct CapsuleAnswer {
  /// The least sum of a voxel centre's distance to the axis and that voxel's distance to a surface, over the observed
  /// ones of these voxels. Where it is below radius + tau, it is the distance from the axis to the nearest surface, to
  /// within about a voxel. Larger distances are not in the map. NaN where no voxel was observed.
  float min_distance_m = std::numeric_limits<float>::quiet_NaN();
  /// Where along the axis, 0 at a, 1 at b, the capsule first collides. NaN where it does not.
  float first_hit_t = std::numeric_limits<float>::quiet_NaN();
  /// min_distance_m is below the radius, or a voxel collides (it was observed closer than r_c to a surface).
  bool collision = false;
  bool unknown = true;  ///< some voxel was neither observed nor cleared, or the capsule was not examined
  /// False: an end is NaN, infinite or has no voxel, the radius is negative or not finite, or the capsule is longer
  /// than 32768 voxels or has more than 2^20 leaves (8^3 voxels). It was not examined: split it.
  bool valid = false;

  /// Every voxel was seen to be free.
  [[nodiscard]] bool free() const { return valid && !collision && !unknown; }
};

class ACCESSVDB_API BatchQuery {
 public:
  /// @param points_W  [n]    @param answers  [n] out
  /// @throws InvalidArgument "query.sizes" if the lengths differ, "query.stale"
  void at(std::span<const Eigen::Vector3d> points_W, std::span<PointAnswer> answers) const;
  /// @param points_W  [3 x n], one position per column
  [[nodiscard]] std::vector<PointAnswer> at(const Eigen::Ref<const Eigen::Matrix3Xd>& points_W) const;

  /// @param capsules  [n]    @param answers  [n] out
  /// @throws InvalidArgument "query.sizes", "query.stale"
  void along(std::span<const CapsuleQuery> capsules, std::span<CapsuleAnswer> answers) const;
  [[nodiscard]] std::vector<CapsuleAnswer> along(std::span<const CapsuleQuery> capsules) const;

  /// AccessibilityField::revision() when this was made.
  [[nodiscard]] std::uint64_t revision() const;
  /// False once the field has changed or is gone.
  [[nodiscard]] bool current() const;

 private:
  friend class internal::FieldViews;
  struct Impl;
  explicit BatchQuery(std::shared_ptr<const Impl> impl);
  std::shared_ptr<const Impl> impl_;
};

}  // namespace accessvdb
