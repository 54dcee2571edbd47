// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What goes into and comes out of an AccessibilityField. Suffix _W: world frame, _S: sensor frame.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "accessvdb/attributes.h"
#include "accessvdb/export.h"
#include "accessvdb/point_label.h"

namespace accessvdb {

/// Why a return was not used. Names in files: name(DropReason).
enum class DropReason : std::uint8_t { NoReturn, NonFinite, BelowMinRange, BeyondMaxRange, OutOfBounds };
inline constexpr int kNumDropReasons = 5;
constexpr const char* name(DropReason reason) {
  constexpr const char* kNames[kNumDropReasons] = {"no_return", "non_finite", "below_min_range", "beyond_max_range",
                                                   "out_of_bounds"};
  return kNames[static_cast<int>(reason)];
}

/// What one integrateScan() did.
struct FrameStats {
  std::uint64_t points_in = 0;
  std::uint64_t points_used = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
  std::uint64_t touched_leaves = 0;  ///< leaves written
  std::uint64_t new_leaves = 0;
  std::uint64_t distance_updates = 0;  ///< (return, voxel) pairs fused
  std::uint64_t cleared_updates = 0;   ///< (return, voxel) pairs marked cleared
  double integrate_ms = 0;             ///< sorting out returns, map and points: everything but the mirror. On a GPU the
                                       ///< first scan after an update begins with its choice, most of it hidden here.
                                       ///< With updateAsync() it includes waiting for the update
  double mirror_ms = 0;                ///< patching the NanoVDB mirror; 0 if a GPU fuses into it
  std::uint64_t changed_leaves = 0;    ///< leaves in which a fact that scoring reads flipped; sent to the mirror
  std::uint64_t mirror_bytes = 0;      ///< sent to the mirror; 0 if a GPU fuses into it
  bool fused_on_device = false;        ///< a GPU fused the scan, and the host follows: FieldParams::fuse_on_host
  // The mirror of distances, if there is one (FieldParams::mirror_distance):
  double distance_mirror_ms = 0;            ///< patching it
  std::uint64_t distance_leaves = 0;        ///< leaves in which distances changed; their changed rows are sent
  std::uint64_t distance_mirror_bytes = 0;  ///< written to it
  std::uint64_t surface_points = 0;         ///< in the field after this scan
  std::uint64_t flipped_voxels = 0;         ///< voxels in which a fact that scoring reads flipped
  std::uint64_t left_out_returns = 0;       ///< of points_used: those for which a map that no longer grows has no place
  /// Sensor positions around which TsdfParams::platform_radius_m cleared nothing, since something is there.
  std::uint64_t contradicted_platforms = 0;
};

/// What one update() did. backlog, withheld_points and label_changes are of several tools the sums over them.
struct UpdateStats {
  std::uint64_t dirty_points = 0;     ///< points looked at
  std::uint64_t scored_points = 0;    ///< points for which at least one direction was tested
  std::uint64_t direction_tests = 0;  ///< (point, direction) tests, arm or tool
  std::uint64_t backlog = 0;          ///< points left for a later update
  std::uint64_t label_changes = 0;    ///< labels as found: that a point waits, and is unscored until then, is none
  double update_ms = 0;  ///< all but testing directions: noting scans since the last update(), choosing points,
                         ///< normals, unless begun with the scan
  double score_ms = 0;   ///< testing directions
  std::uint64_t moved_points =
      0;  ///< points whose normal and seen directions were computed again; part of dirty_points
  std::uint64_t backlog_updates = 0;  ///< updates, this one included, that have left the first point of the backlog
  /// Of the backlog, points that were accessible when they were last scored. Like all of it they are unscored until
  /// their turn comes.
  std::uint64_t withheld_points = 0;
};

/// One surface point as users see it.
struct SurfacePoint {
  std::uint32_t id = 0;                    ///< stable over the life of the field
  Eigen::Vector3d position_W = {0, 0, 0};  ///< first return in its voxel, metres
  Eigen::Vector3f normal_W = {0, 0, 0};    ///< unit, towards the mean sensor position; zero where there is none
  /// Unit, outwards along the tool's body; the tool travels along -direction_W.
  Eigen::Vector3f direction_W = {0, 0, 0};
  float yaw_rad = 0;                       ///< of direction_W
  std::uint16_t direction = kNoDirection;  ///< its index; of yaw directions d, yaw = 2 pi d / D
  std::uint8_t roll = 0;                   ///< index of the best roll in that direction
  std::uint8_t tool = 0;                   ///< of several tools: the first that reaches the point, else the closest
  std::uint32_t tools = 0;                 ///< of several tools: bit k is set if tool k reaches the point
  /// Of a field with margins (withMargins()): the largest with which the tool that stands for the point still reaches
  /// it, 0 if it reaches it with none. -1: it does not, or the field has no margins.
  float margin_m = -1;
  /// In files of a field with margins, AccessibilityField::freeArcs_deg() of the tool that stands for the point; else
  /// -1.
  float free_arc_deg = -1;
  std::uint16_t score = kNoScore;  ///< fewest collisions of any direction
  float weight = 0;                ///< [w] observations behind the confidence
  float confidence = 0;            ///< [c] in [0, 1)
  float stability = 1;             ///< [a] in [0, 1]
  /// How likely it is, in [0, 1], that the exact tool reaches the point in the cone around this normal
  /// (access_probability.h). -1: nothing is said: it is unscored, or its reason is Normal or Unseen.
  float access_probability = -1;
  PointLabel label = PointLabel::Unscored;
  PointReason reason = PointReason::Confidence;
  /// Accessible, c*a above UpdateParams::stability_min, and an update() came after the last scan and left no point
  /// waiting (its backlog is 0).
  bool confident = false;
  /// World from tool, w >= 0: how the tool is held in that direction. Identity if there is none.
  Eigen::Quaternionf orientation_WT = Eigen::Quaternionf::Identity();
};

/// All surface points at one moment, in the order of their ids.
struct ACCESSVDB_API FieldSnapshot {
  std::vector<SurfacePoint> points;
  Eigen::Vector3d origin_W = {0, 0, 0};  ///< world position of the map's local origin
  double voxel_size_m = 0;
  std::vector<AttributeColumn> attributes = {};  ///< what the returns carried (FieldParams::carry), point by point

  [[nodiscard]] std::vector<SurfacePoint> with(PointLabel label) const;
  [[nodiscard]] std::vector<SurfacePoint> accessible() const { return with(PointLabel::Accessible); }
  [[nodiscard]] std::uint64_t count(PointLabel label) const;
  [[nodiscard]] std::array<std::uint64_t, kNumPointReasons> reasons() const;
};

/// Bytes by owner.
struct MemoryUse {
  std::uint64_t map_bytes = 0;              ///< authored leaves and tree
  std::uint64_t mirror_bytes = 0;           ///< NanoVDB mirror
  std::uint64_t distance_mirror_bytes = 0;  ///< mirror of distances; 0 if there is none
  std::uint64_t point_host_bytes = 0;       ///< authoring side of the points and of the tool's tables
  std::uint64_t point_device_bytes = 0;     ///< point state arrays, and the tool's tables; host memory on the CPU
  std::uint64_t device_peak_bytes = 0;      ///< peak GPU memory held, without the driver's own; 0 on the CPU
  std::uint64_t leaves = 0;
  std::uint64_t active_voxels = 0;  ///< observed voxels
};

}  // namespace accessvdb
