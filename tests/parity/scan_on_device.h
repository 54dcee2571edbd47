// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A device's copy of a map: it fuses the same scans by itself. What differs from the map after each of them.
#pragma once

#include <openvdb/Types.h>

#include <Eigen/Core>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <vector>

#include "cuda/cuda_backend.h"
#include "mirror/nanovdb_mirror.h"
#include "tsdf/integration_result.h"
#include "tsdf/packed_map.h"
#include "tsdf/return_region.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb::test {

/// Leaves, points or counts in which the device differs from the map.
struct FusionDifferences {
  std::uint64_t leaves = 0, facts = 0, values = 0, cleared = 0, votes = 0, weights = 0, flips = 0, counts = 0;
  [[nodiscard]] std::uint64_t all() const {
    return leaves + facts + values + cleared + votes + weights + flips + counts;
  }
};

/// A map that gets the scans later, as late as it may.
class MapBehind final : public kernels::FollowingMap {
 public:
  /// @param map  empty  @param scans_behind  0: it has got each scan before the next
  MapBehind(std::unique_ptr<internal::PackedMap> map, std::size_t scans_behind);
  void take(std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);

  void read(std::span<kernels::LeafRecord> leaves) override;
  [[nodiscard]] std::uint64_t scans() const override { return scans_; }
  void wait() override { catchUp(0); }

  [[nodiscard]] std::uint64_t leavesRead() const { return leaves_read_; }
  /// For a device that begins with its map: from now on scans are counted from 0.
  void beginAgain() {
    wait();
    scans_ = 0;
  }

 private:
  void catchUp(std::size_t behind);
  struct Scan {
    std::vector<Eigen::Vector3f> p_L, q_L;
  };
  std::unique_ptr<internal::PackedMap> map_;
  internal::ScanIntegrator integrator_;
  std::deque<Scan> waiting_;
  std::size_t behind_;
  std::uint64_t scans_ = 0, leaves_read_ = 0;
};

class ScanOnDevice {
 public:
  /// @param map  empty  @param behind  of the same kind  @param cache_bytes  FusionSetting's
  ScanOnDevice(kernels::CudaBackend& backend, const internal::PackedMap& map, MapBehind& behind,
               std::uint64_t cache_bytes = 0);

  /// Call before the map integrates the scan: which returns are news, and where the platform may be, depends on it.
  /// @param q_L  [n] or [1]
  void fuse(const internal::PackedMap& map, std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  /// Forgets all but the grid, and begins with the map that the host has after the latest scan.
  void beginAgain(const internal::PackedMap& map);
  /// Of the whole map. @param result  of the scan, after the map integrated it
  [[nodiscard]] FusionDifferences compare(const internal::PackedMap& map, const internal::IntegrationResult& result);

  /// Leaves with values of which the device held none in compare().
  [[nodiscard]] std::uint64_t leavesOnHost() const { return on_host_; }
  /// Of the last scan's kernels.
  [[nodiscard]] float milliseconds() { return fuser_->lastMilliseconds(); }
  /// Of the last call that fused, from when the rays were ready.
  [[nodiscard]] double callMilliseconds() const { return call_ms_; }
  [[nodiscard]] std::uint64_t newsCount() const { return news_; }
  /// Leaves that more cones reach than a word of their sums can count.
  [[nodiscard]] std::uint64_t wideLeafCount();
  /// Device memory without the grid's.
  [[nodiscard]] std::uint64_t bytes() const { return fuser_->bytes(); }

 private:
  [[nodiscard]] std::unique_ptr<kernels::DeviceScanFuser> makeFuser(const internal::PackedMap& map);
  void compareFlips(const internal::IntegrationResult& result, FusionDifferences& found);
  void compareWeights(const internal::PackedMap& map, FusionDifferences& found);

  kernels::CudaBackend& backend_;
  MapBehind& behind_;
  kernels::MirrorArena* arena_;
  internal::NanoVdbMirror mirror_;
  internal::RegionShape shape_;
  kernels::GridSpace space_;
  std::uint64_t cache_bytes_;
  std::unique_ptr<kernels::DeviceScanFuser> fuser_;
  std::vector<kernels::ReturnRay> rays_;
  kernels::FusedScan last_;
  double call_ms_ = 0;
  std::uint64_t on_host_ = 0;
  std::uint64_t news_ = 0;  ///< by the host's rule
};

}  // namespace accessvdb::test
