// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which surface points have gone: those whose own voxel a ray has opened, until the next return there.
///
/// Opening a voxel also takes its observations, which are what the confidence of the points around rests on. Confidence
/// does not age, so it keeps those points' weights as they were.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "change/ray_evidence.h"
#include "points/point_store.h"
#include "tsdf/removed_voxels.h"

namespace accessvdb::internal {

class GonePoints {
 public:
  /// Observations behind the confidence of each id, as the map says.
  using ReadWeights = std::function<void(std::span<const std::uint32_t> ids, std::span<std::uint16_t> weights)>;

  /// Call before the voxels are opened.
  void noteOpened(const PointStore& points, std::span<const OpenedLeaf> opened, const ReadWeights& read);
  /// A person took these voxels out: what was kept of the points around them is forgotten. @param as_free  the points
  /// in them have gone; else they have when a ray opens their voxel
  void noteRemoved(const PointStore& points, const VoxelSet& voxels, bool as_free);
  /// Points that got a return are there again.
  void noteReturns(std::span<const std::uint32_t> touched);

  /// Points with this id or a higher one have never been near an opened voxel.
  [[nodiscard]] std::uint32_t size() const { return static_cast<std::uint32_t>(least_weight_.size()); }
  [[nodiscard]] std::uint16_t leastWeight(std::uint32_t id) const { return id < size() ? least_weight_[id] : 0; }
  [[nodiscard]] bool isGone(std::uint32_t id) const { return id < size() && gone_[id] != 0; }
  [[nodiscard]] std::uint64_t count() const { return count_; }

  /// What the points were at the last update: labels are as of that.
  void publish();
  [[nodiscard]] const std::vector<std::uint8_t>& published() const { return published_; }

  /// @param id  ascending from call to call
  void restore(std::uint32_t id, std::uint16_t least_weight, bool gone);
  [[nodiscard]] std::uint64_t bytes() const {
    return least_weight_.capacity() * sizeof(std::uint16_t) + gone_.capacity() + published_.capacity();
  }

 private:
  void grow(std::uint32_t size);
  void markGone(std::span<const std::uint32_t> ids);

  std::vector<std::uint16_t> least_weight_;
  std::vector<std::uint8_t> gone_, published_;  ///< 1: gone
  std::uint64_t count_ = 0;
  bool changed_ = false;  ///< since publish()
};

}  // namespace accessvdb::internal
