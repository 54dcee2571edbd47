// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The fusion of one scan on a device, from the map as it is before the scan, and what differs from the map afterwards.
#pragma once

#include <openvdb/Types.h>

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "cuda/fusion/fuse_leaves.h"
#include "launch/device_array.h"
#include "tsdf/integration_result.h"
#include "tsdf/packed_map.h"

namespace accessvdb::test {

/// Leaves, or counts, in which the device differs from the map.
struct FusionDifferences {
  std::uint64_t reached = 0, values = 0, cleared = 0, votes = 0, flips = 0, counts = 0;
  [[nodiscard]] std::uint64_t all() const { return reached + values + cleared + votes + flips + counts; }
};

class ScanOnDevice {
 public:
  explicit ScanOnDevice(kernels::DeviceMemory& memory) : memory_(memory) {}

  /// Copies what the scan may reach, before the map integrates it. @param q_L  [n] or [1]
  void take(const internal::PackedMap& map, std::span<const Eigen::Vector3f> p_L, std::span<const Eigen::Vector3f> q_L);
  /// Fuses the scan into what take() copied, each time anew. @return milliseconds of the kernel
  float fuse();
  /// @param map, result  after the map integrated the scan
  [[nodiscard]] FusionDifferences compare(const internal::PackedMap& map, const internal::IntegrationResult& result);

  [[nodiscard]] std::uint64_t leafCount() const { return leaves_.size(); }
  [[nodiscard]] std::uint64_t entryCount() const { return entries_.size(); }
  /// Leaves that more cones reach than a word of their sums can count.
  [[nodiscard]] std::uint64_t wideLeafCount() const { return wide_; }
  [[nodiscard]] std::uint64_t votedLeafCount() const { return votes_.size() / 48; }
  [[nodiscard]] std::uint64_t newsCount() const { return news_; }

 private:
  void addLeaf(const internal::PackedMap& map, const std::array<std::int32_t, 3>& origin_ijk,
               std::span<const kernels::LeafEntry> entries, std::uint32_t slot);
  void download();

  kernels::DeviceMemory& memory_;
  std::uint64_t wide_ = 0, news_ = 0;
  kernels::FusionView view_ = {};
  std::vector<kernels::ReturnRay> rays_;
  std::vector<kernels::LeafEntry> entries_;
  std::vector<kernels::FusedLeaf> leaves_;
  std::vector<std::uint32_t> values_, cleared_, votes_;  ///< before the scan
  std::vector<std::uint8_t> existed_, had_values_;       ///< by slot
  std::vector<std::uint32_t> new_values_, new_cleared_, new_votes_;
  std::vector<kernels::FusedOutcome> outcomes_;
  std::vector<kernels::FusedFlips> flips_;
  kernels::DeviceArray<kernels::ReturnRay> d_rays_;
  kernels::DeviceArray<kernels::LeafEntry> d_entries_;
  kernels::DeviceArray<kernels::FusedLeaf> d_leaves_;
  kernels::DeviceArray<std::uint32_t> d_values_, d_cleared_, d_votes_;
  kernels::DeviceArray<kernels::FusedOutcome> d_outcomes_;
  kernels::DeviceArray<kernels::FusedFlips> d_flips_;
};

}  // namespace accessvdb::test
