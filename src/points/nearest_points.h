// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact k nearest surface points of each point of a block, by (squared distance in steps, id).
///
/// Blocks are gathered ring by ring around the central one: a point is done when the gathered box reaches farther than
/// its k-th neighbour. Candidates are selected in float32 lanes with a bound on their error; the final order uses
/// distances in whole steps (hostdev/neighbour_rule.h).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "hostdev/neighbour_rule.h"
#include "points/near_kernels.h"
#include "points/point_store.h"

namespace accessvdb::internal {

struct NearPoint {
  std::int64_t squared_distance;  ///< steps^2
  std::uint32_t id;
  kernels::NeighbourOffset offset;  ///< from the point, steps

  [[nodiscard]] bool operator<(const NearPoint& other) const {
    return squared_distance != other.squared_distance ? squared_distance < other.squared_distance : id < other.id;
  }
};

/// Scratch memory of one thread.
class NearestPoints {
 public:
  /// @param radius_m  no neighbour is farther away
  /// @param in_front  this many of the nearest come first
  NearestPoints(const PointStore& points, std::size_t k, std::size_t in_front, double voxel_size_m, double radius_m,
                const NearKernels& kernels = nearKernels());

  /// Calls visit(index into ids, nearest points) for each of some points of one block, in any order. The nearest points
  /// include the point itself.
  template <typename Visit>
  void forEach(const Index3& leaf, std::span<const std::uint32_t> ids, const Visit& visit) {
    pending_.resize(ids.size());
    for (std::size_t n = 0; n < ids.size(); ++n) pending_[n] = static_cast<std::uint32_t>(n);
    for (std::int32_t rings = 0; !pending_.empty(); rings = std::clamp(2 * rings, 1, most_rings_)) {
      if (rings == 0) {
        gatherNear(ids);
      } else {
        gather(leaf, rings);
      }
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

  [[nodiscard]] double stepsPerMetre() const { return steps_per_m_; }
  /// Largest squared distance of a neighbour, steps^2.
  [[nodiscard]] std::int64_t radiusSquared() const { return radius_squared_; }

 private:
  void gather(const Index3& leaf, std::int32_t rings);
  void gatherNear(std::span<const std::uint32_t> ids);
  bool find(std::uint32_t id);
  void list(const Eigen::Vector3f& centre, std::int64_t squared);

  const PointStore& points_;
  const NearKernels& kernels_;
  std::size_t k_, in_front_;
  double voxel_size_m_, radius_m_, steps_per_m_;
  std::int64_t radius_squared_;
  std::int32_t most_rings_;
  bool complete_ = false;               ///< everything within the radius of the block is gathered
  std::int64_t guess_;                  ///< squared distance of the last k-th neighbour, plus a margin
  Eigen::Vector3d box_low_, box_high_;  ///< everything inside is gathered
  NearPositions positions_;
  std::vector<std::uint32_t> ids_;  ///< of positions_
  std::vector<std::uint32_t> pending_, found_;
  std::vector<NearPoint> nearest_;
};

}  // namespace accessvdb::internal
