// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The k nearest surface points of the points of one block, exactly, by (squared distance, id).
///
/// Blocks are gathered ring by ring around the own one: a point is done when the gathered box reaches farther than its
/// k-th neighbour. Which positions come into question is decided in float32 lanes with a bound on their error; the
/// order by distances in double.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "points/near_kernels.h"
#include "points/point_store.h"

namespace accessvdb::internal {

struct NearPoint {
  double squared_distance;  ///< m^2
  std::uint32_t id;
  std::uint32_t position;  ///< index into NearestPoints::positions()
};

/// Scratch memory of one thread.
class NearestPoints {
 public:
  /// @param radius_m  no neighbour is farther away
  NearestPoints(const PointStore& points, std::size_t k, double voxel_size_m, double radius_m,
                const NearKernels& kernels = nearKernels());

  /// Calls visit(index into ids, nearest points in ascending order) for each of some points of one block, in any order.
  /// The point itself is among them.
  template <typename Visit>
  void forEach(const Index3& leaf, std::span<const std::uint32_t> ids, const Visit& visit) {
    pending_.resize(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) pending_[n] = static_cast<std::uint32_t>(n);
    for (std::int32_t rings = 1; !pending_.empty(); rings = std::min(2 * rings, most_rings_)) {
      gather(leaf, std::min(rings, most_rings_));
      std::size_t left = 0;
      for (const std::uint32_t n : pending_) {
        if (find(ids[n])) {
          visit(n, std::span<const NearPoint>(nearest_));
        } else {
          pending_[left++] = n;
        }
      }
      pending_.resize(left);
    }
  }

  /// Positions that NearPoint::position refers to, while visit() runs.
  [[nodiscard]] const NearPositions& positions() const { return positions_; }

 private:
  void gather(const Index3& leaf, std::int32_t rings);
  bool find(std::uint32_t id);
  void list(const Eigen::Vector3f& centre, double squared);
  void sortNearest();

  const PointStore& points_;
  const NearKernels& kernels_;
  std::size_t k_;
  double voxel_size_m_, radius_m_;
  std::int32_t most_rings_;
  bool complete_ = false;               ///< everything within the radius of the block is gathered
  double guess_;                        ///< squared distance of the last k-th neighbour and some more
  Eigen::Vector3d box_low_, box_high_;  ///< everything inside is gathered
  NearPositions positions_;
  std::vector<std::uint32_t> ids_;  ///< of positions_
  std::vector<std::uint32_t> pending_, found_;
  std::vector<NearPoint> nearest_, unsorted_;
  std::vector<std::int64_t> keys_;
  std::vector<std::int32_t> ranks_;
};

}  // namespace accessvdb::internal
