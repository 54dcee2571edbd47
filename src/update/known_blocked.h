// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the exact policy knows of a point's blocked directions, and how flips for the better erode that knowledge.
#pragma once

#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "hostdev/direction_search.h"
#include "update/flip_set.h"
#include "update/offset_directions.h"

namespace accessvdb::internal {

/// Directions of a point known to be blocked under the current map, by the stage that blocks them.
struct KnownBlocked {
  DirectionMask arm = {};   ///< at least one corridor sample is blocked
  DirectionMask tool = {};  ///< at least n_c + margin voxels collide
  std::uint16_t margin = 0;

  void learn(const kernels::ScoreResult& result, std::uint16_t collision_limit);

  /// Removes the directions in `tool` that flips may have freed. Each flip removes at most one collision from a
  /// direction, so up to `margin` flips in its voxels leave it blocked.
  /// @param flips  voxels that stopped colliding; may lie anywhere
  /// @return directions no longer known to be blocked, and those never known to be blocked that read one of the flips
  DirectionMask release(const Index3& point_voxel, std::span<const Index3> flips, const OffsetDirections& directions);
};

/// Voxels that stopped colliding since the last update, by position.
class FreedVoxels {
 public:
  explicit FreedVoxels(const FlipSet& flips);
  [[nodiscard]] bool empty() const { return cells_.empty(); }
  /// Appends those inside a box, inclusive.
  void collect(const Index3& low, const Index3& high, std::vector<Index3>& out) const;

 private:
  static constexpr int kCellShift = 6;  ///< cells of 64^3 voxels
  std::unordered_map<std::uint64_t, std::vector<Index3>> cells_;
};

}  // namespace accessvdb::internal
