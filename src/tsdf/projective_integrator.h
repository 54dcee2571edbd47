// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The projective baseline: voxels look up the scan's range image, instead of returns updating the voxels around them.
///
/// For a voxel centre x seen from the sensor q in a bin with range r, d = r - |x - q|:
///   d < -tau        skipped (behind the surface)
///   |d| <= tau      S += clamp(d), w += 1   (docs/PAPER_MAP.md, "Baselines")
///   d > tau         skipped, or with `in_front` S += tau, w += 1
///   empty bin       skipped, or with `empty_is_free`, inside the elevation range, S += tau, w += 1
///
/// `guarded` is how nvblox projects LiDAR scans (nvidia-isaac/nvblox, sensors/internal/impl/lidar_impl.h,
/// Lidar::interpolateDepthImage, commit 2ecd5722): r is interpolated between the four bin centres around the voxel if
/// all four are filled and none differs from the interpolated range by more than 2 voxels; otherwise r is the range of
/// the voxel's own bin, but only if the voxel's centre is within half a voxel of the ray through that bin's centre;
/// otherwise the voxel is skipped. Not taken from nvblox: weights other than 1 (its default falls with the square of
/// the range), its cap of 5 (TsdfParams::max_weight applies), decay, and its integration distance (10 m). Its columns
/// end at the seam; ours wrap around.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "tsdf/integration_result.h"
#include "tsdf/leaf_fusion.h"
#include "tsdf/packed_map.h"
#include "tsdf/range_image.h"
#include "tsdf/return_bins.h"

namespace accessvdb::internal {

class ProjectiveIntegrator {
 public:
  explicit ProjectiveIntegrator(PackedMap& map);
  ~ProjectiveIntegrator();

  /// @throws InvalidArgument unless there is exactly one sensor position
  static void requireOneSensor(std::span<const Eigen::Vector3f> q_L);

  /// See ScanIntegrator::noteDistances().
  void noteDistances(bool wanted) { wants_distances_ = wanted; }

  /// Fuses a scan and adds what happened to `result`, which may already contain the changes of its cleared band. Of
  /// both together, each leaf is listed once, and a voxel that flipped back not at all. Leaves written by both count
  /// twice in touched_leaves.
  void integrate(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L, const ScanFrame& frame,
                 IntegrationResult& result);

 private:
  void collectBandLeaves(const Eigen::Vector3f& q_L, const Eigen::Matrix3d& R_W_S);
  void collectBoxLeaves(const Eigen::Vector3d& origin_W);
  void mergeChanges(IntegrationResult& result);
  [[nodiscard]] float measuredRange(const LeafProjection& seen, std::size_t n, const Eigen::Vector3f& first_S,
                                    const Eigen::Matrix3f& steps) const;
  /// @return pairs of rows that got samples
  [[nodiscard]] std::uint32_t sample(const LeafProjection& seen, const Eigen::Vector3f& first_S,
                                     const Eigen::Matrix3f& steps, LeafSums& sums) const;

  PackedMap& map_;
  ProjectiveParams params_;
  float tau_, clamp_low_, sample_scale_;  ///< voxels, voxels, steps per voxel
  float view_low_, view_high_;            ///< rows between which an empty bin can count as free
  RangeImage image_;
  std::vector<LeafKey> leaves_;  ///< leaves to be examined, sorted
  std::vector<LeafChange> changes_;
  std::vector<DistanceChange> distances_;
  bool wants_distances_ = false;
  struct Workers;
  std::unique_ptr<Workers> workers_;
};

}  // namespace accessvdb::internal
