// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Does the tool fit here: the field's own tools at any pose, against the live map.
///
///   const accessvdb::PoseQuery query = field.poseQuery();
///   query.fits(T_WT, answers);                 // tool poses, world frame
///   query.fitsAlong(path).first_hit;           // moved from each pose to the next
///
/// A pose T_WT takes the tool's frame to the world: the tip is at its translation, and the tool's body extends along
/// its x axis (docs/tools.md). Every voxel counts that any part of the tool may be in, however it is turned: none is
/// missed, and none that counts is farther than two voxels from the tool. Unknown space is reported apart and is not
/// free; bad poses are never free.
///
/// Threads  Any number of threads may use one PoseQuery, or copies of it, at the same time; on a GPU they take turns.
///          Answers do not depend on their number, nor on the backend.
/// Validity As of a BatchQuery: until the field next changes, then every call throws InvalidArgument "query.stale".
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

namespace internal {
class PoseFits;
}
namespace kernels {
struct ToolBitmapView;
}

/// How a pose is meant.
struct FitOptions {
  std::size_t tool = 0;  ///< of the field's tools
  /// The tool touches a surface point with its tip, as where the field scores it: its tip stands for the voxel that it
  /// is in, what is within ScoringParams::self_exclusion_voxels of it is left out, and fewer collisions than the
  /// field's limit are none. Voxels are then those of the field's own tables. For the field's own orientations the
  /// count is that of the field (DirectionOutcome::score).
  bool contact = false;
};

/// How a way is meant.
struct PathFitOptions {
  std::size_t tool = 0;         ///< of the field's tools
  bool unknown_blocks = false;  ///< unknown space ends the way, as a collision does
};

/// What the tool meets at a pose.
struct FitAnswer {
  std::uint32_t collisions = 0;       ///< colliding voxels
  std::uint32_t collision_limit = 1;  ///< fewest that block: 1, in contact the field's own
  std::uint32_t unknown_voxels = 0;   ///< voxels that were neither observed nor cleared
  /// False: the pose is no rotation and translation, not finite or outside the map's range, or the tool spans too many
  /// voxels. Nothing was looked at.
  bool valid = false;

  [[nodiscard]] bool collision() const { return !valid || collisions >= collision_limit; }
  /// Where the field scores a point in contact, it takes these for free.
  [[nodiscard]] bool unknown() const { return !valid || unknown_voxels > 0; }
  /// No collision, and all of it was seen to be free.
  [[nodiscard]] bool free() const { return !collision() && !unknown(); }
};

/// What the tool meets on its way from pose to pose: between two it moves evenly along the line and turns evenly about
/// one axis. No part of it moves by more than half a voxel between the poses that are tried, so what it passes by may
/// cut less than a quarter of a voxel off a corner of it.
struct PathFitAnswer {
  /// Where it first collides: 1.25 is a quarter of the way from the second pose to the third. NaN if nowhere.
  double first_hit = std::numeric_limits<double>::quiet_NaN();
  /// The last place that was tried before the first collision, or before what ends the way: 2 is the third pose. NaN if
  /// that is the first pose.
  double fits_until = std::numeric_limits<double>::quiet_NaN();
  bool collision = true;  ///< also if it is not valid
  bool unknown = true;    ///< before the first collision, or where the way ends
  /// False: there are no poses, one is bad (FitAnswer::valid), or the way takes more than 2^20 tries.
  bool valid = false;

  [[nodiscard]] bool free() const { return valid && !collision && !unknown; }
};

class ACCESSVDB_API PoseQuery {
 public:
  /// @param T_WT  [n]    @param answers  [n] out
  /// @throws InvalidArgument "query.sizes" if the lengths differ, "query.stale", "tool.index"; ResourceLimit
  /// "tool.span"
  void fits(std::span<const Eigen::Isometry3d> T_WT, std::span<FitAnswer> answers,
            const FitOptions& options = {}) const;
  [[nodiscard]] std::vector<FitAnswer> fits(std::span<const Eigen::Isometry3d> T_WT,
                                            const FitOptions& options = {}) const;
  /// @param T_WT  [n] poses on the way, at least one
  /// @throws as fits()
  [[nodiscard]] PathFitAnswer fitsAlong(std::span<const Eigen::Isometry3d> T_WT,
                                        const PathFitOptions& options = {}) const;

  /// What the tool meets on the last part of its way to contact, straight along its body from contactWay_m() before it:
  /// the most of all voxels that its tip is in on the way, each judged as where the field scores a point
  /// (FitOptions::contact). Before that, fits() judges.
  /// @param contact_T_WT  [n] poses in contact  @param tool  of the field's tools  @return [n]  @throws as fits()
  [[nodiscard]] std::vector<FitAnswer> fitsIntoContact(std::span<const Eigen::Isometry3d> contact_T_WT,
                                                       std::size_t tool = 0) const;
  /// ScoringParams::self_exclusion_voxels and two voxels: nearer, the tool touches what it works on, and fits() counts
  /// up to two voxels around it.
  [[nodiscard]] double contactWay_m(std::size_t tool = 0) const;

  /// A tool for DeviceView::fits() in your own kernels; include device_view.h. In the field's memory, as its
  /// deviceView() or hostView(), and there as long as the field. @throws InvalidArgument "tool.index"; ResourceLimit
  /// "tool.span"
  [[nodiscard]] kernels::ToolBitmapView toolView(std::size_t tool = 0) const;

  /// AccessibilityField::revision() when this was made.
  [[nodiscard]] std::uint64_t revision() const;
  /// False once the field has changed or is gone.
  [[nodiscard]] bool current() const;

 private:
  friend class internal::PoseFits;
  struct Impl;
  explicit PoseQuery(std::shared_ptr<const Impl> impl);
  std::shared_ptr<const Impl> impl_;
};

}  // namespace accessvdb
