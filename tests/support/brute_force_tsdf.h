// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The product profile's integration, implemented a second time, in double, one loop per return: which voxels a return
/// updates, with what distance, and which it marks cleared. Reports how close each decision was, so that a test can
/// skip voxels where rounding may legitimately decide otherwise.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <unordered_map>

#include "support/dense_map.h"

namespace accessvdb::test {

struct BruteForceTsdfParams {
  double voxel_size_m = 0.01;
  double tau_m = 0.04;  ///< [tau]
  double cone_cos_min = 0.95;
  double clamp_min_m = 0.0;
  double cleared_radius_voxels = 2.5;
  double cleared_begin_tau = 0.5;  ///< exclusive
  double cleared_end_tau = 2.25;   ///< inclusive
};

struct BruteForceTsdfVoxel {
  double sum_m = 0;         ///< sum of the clamped distances
  std::uint32_t count = 0;  ///< observations
  bool cleared = false;
  /// Least change of a length, in metres, that would add or remove an update of this voxel by a return.
  double update_margin_m = std::numeric_limits<double>::infinity();
  /// Same for the cleared flag, which one return is enough to set: positive inside, negative outside.
  double cleared_depth_m = -std::numeric_limits<double>::infinity();
};

/// Fuses scan after scan. Visits every voxel of the box around each return and around its cleared band, one voxel more
/// on each side, so that near misses have a margin too; they are in voxels() with count 0 and cleared false.
/// The weight is not capped: stay below the cap.
class BruteForceTsdf {
 public:
  explicit BruteForceTsdf(const BruteForceTsdfParams& params) : params_(params) {}

  /// @param points_L  [n] returns, local frame, metres; all of them are used
  /// @param sensor_L  [1] or [n] where they were seen from
  void integrate(std::span<const Eigen::Vector3d> points_L, std::span<const Eigen::Vector3d> sensor_L);

  [[nodiscard]] const std::unordered_map<VoxelCoord, BruteForceTsdfVoxel, VoxelCoordHash>& voxels() const {
    return voxels_;
  }
  /// As scoring sees it: mean distance rounded to float. So the class serves as a MapLookup (std::ref).
  [[nodiscard]] MapVoxel operator()(const VoxelCoord& voxel) const;

 private:
  void integrateReturn(const Eigen::Vector3d& p, const Eigen::Vector3d& q);

  BruteForceTsdfParams params_;
  std::unordered_map<VoxelCoord, BruteForceTsdfVoxel, VoxelCoordHash> voxels_;
};

}  // namespace accessvdb::test
