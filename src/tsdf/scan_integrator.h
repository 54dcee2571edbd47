// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fuses the returns of a scan into the map (paper, "Scan-centric TSDF"; docs/PAPER_MAP.md, "Integration", "Ray-cleared
/// band").
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "tsdf/bucket_fusion.h"
#include "tsdf/integration_result.h"
#include "tsdf/leaf_fusion.h"
#include "tsdf/leaf_reserve.h"
#include "tsdf/packed_map.h"
#include "tsdf/return_bins.h"

namespace accessvdb::internal {

class ProjectiveIntegrator;

class ScanIntegrator {
 public:
  explicit ScanIntegrator(PackedMap& map);
  ~ScanIntegrator();

  /// Whether results list the leaves with changed distances.
  void noteDistances(bool wanted);
  /// Whether results have a hash of their flips.
  void hashFlips(bool wanted);

  /// Called with the changes that integrate() will return, as soon as they are known. From several threads, but for
  /// those of a list from one at a time; list < kLists.
  using ChangeVisitor = std::function<void(std::size_t list, const LeafChange& change)>;
  static constexpr std::size_t kLists = ReturnBins::kBuckets;
  void visitChanges(const ChangeVisitor& visit);

  /// Sorts the returns without changing the map; integrate() must get the same ones next. Otherwise it sorts them.
  void bin(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  /// @param p_L  [n] finite returns in the local frame, metres, none at its sensor
  /// @param q_L  [n] or [1] sensor positions in the local frame
  /// @throws InvalidArgument if the region is Projective and there is not exactly one sensor position; std::bad_alloc;
  ///         then the map is unchanged or contains part of the scan
  IntegrationResult integrate(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L,
                              const ScanFrame& frame = {});

  /// Reads leaves that the scan does not reach which another thread may be in integrate() with. Not for
  /// UpdateRegion::Projective.
  /// @param origins_ijk  lowest voxels  @param read  (n, leaf), once for each, from several threads; nullptr: there is
  /// no such leaf; it must not throw
  void readLeaves(std::span<const std::array<std::int32_t, 3>> origins_ijk,
                  const std::function<void(std::size_t n, const PackedLeaf* leaf)>& read);

 private:
  void integrateProjected(std::span<const Eigen::Vector3f> p_L, const Eigen::Vector3f& q_L, const ScanFrame& frame,
                          IntegrationResult& result);

  PackedMap& map_;
  std::shared_mutex tree_;                               ///< held to read leaves, and alone to link nodes
  std::array<std::mutex, ReturnBins::kBuckets> leaves_;  ///< of each bucket: BucketFusion::fuse()
  RegionShape shape_;
  ReturnBins bins_;
  std::vector<ReturnRay> rays_;
  bool binned_ = false;  ///< bin() was called
  std::uint64_t contradicted_platforms_ = 0;
  LeafReserve reserve_;
  // Only for UpdateRegion::Projective, whose changes are known last:
  ChangeVisitor visit_;
  bool wants_hash_ = false;
  struct Workers;
  std::unique_ptr<Workers> workers_;                         ///< one BucketFusion per thread
  std::unique_ptr<ProjectiveIntegrator> projective_;         ///< only for UpdateRegion::Projective
  std::array<BucketChanges, ReturnBins::kBuckets> changes_;  ///< kept so that memory is reused
};

}  // namespace accessvdb::internal
