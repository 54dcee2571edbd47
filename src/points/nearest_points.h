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
#include <utility>
#include <vector>

#include "hostdev/neighbour_rule.h"
#include "points/near_kernels.h"
#include "points/point_store.h"

namespace accessvdb::internal {

/// The neighbours of a point, itself included.
struct Neighbours {
  kernels::NeighbourSums sums;             ///< of their offsets
  std::int64_t farthest;                   ///< largest squared distance, steps^2
  std::span<const std::uint32_t> nearest;  ///< ids of the nearest of them, in any order
};

/// Scratch memory of one thread.
class NearestPoints {
 public:
  /// @param radius_m  no neighbour is farther away
  /// @param named  at most this many of them are named
  NearestPoints(const PointStore& points, std::size_t k, std::size_t named, double voxel_size_m, double radius_m,
                const NearKernels& kernels = nearKernels());

  /// Calls visit(index into ids, neighbours) for each of some points of one block, in any order.
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
          visit(n, std::as_const(neighbours_));
        } else {
          pending_[left++] = n;
        }
      }
      pending_.resize(left);
    }
  }

  [[nodiscard]] double stepsPerMetre() const { return steps_per_m_; }

 private:
  void gather(const Index3& leaf, std::int32_t rings);
  void gatherNear(std::span<const std::uint32_t> ids);
  bool find(std::uint32_t id);
  std::size_t measure(const Eigen::Vector3f& centre, std::int64_t squared);
  double nth(std::size_t n, double most, std::size_t within) const;
  void dropFarthest(double squared, std::size_t more);
  void name(double most, std::size_t within);

  const PointStore& points_;
  const NearKernels& kernels_;
  std::size_t k_, named_;
  double voxel_size_m_, radius_m_, steps_per_m_;
  std::int64_t radius_squared_;
  std::int32_t most_rings_;
  bool complete_ = false;               ///< everything within the radius of the block is gathered
  std::int64_t guess_;                  ///< squared distance of the last k-th neighbour, plus a margin
  Eigen::Vector3d box_low_, box_high_;  ///< everything inside is gathered
  NearPositions positions_;
  std::vector<std::uint32_t> ids_;  ///< of positions_
  std::vector<std::uint32_t> pending_, found_, near_blocks_;
  // Of those in found_.
  std::vector<float> near_m_;
  std::vector<double> steps_;
  OffsetArrays offsets_;
  std::vector<std::uint32_t> listed_, names_;
  Neighbours neighbours_;
};

}  // namespace accessvdb::internal
