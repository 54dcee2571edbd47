// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inverse of the corridor: in which directions may a sample lie in the voxel at a given offset from the point's? A
/// few voxels become free near a block in an update, so it is cheaper to look up the directions of each than the
/// samples of each direction.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "hostdev/freed_corridors.h"
#include "hostdev/views.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

class CorridorOffsets {
 public:
  /// Longest reach, in voxels, for which the table pays off on a processor (1.2 MB). With smaller voxels, asking by
  /// leaf is precise enough.
  static constexpr std::int32_t kMostReach = 96;

  /// Empty if samples lie above or below the point, or farther away than `most_reach`, and for wide sets.
  CorridorOffsets(const kernels::ApproachView& approach, double voxel_size_m, std::int32_t most_reach = kMostReach);

  [[nodiscard]] bool empty() const { return table_.empty(); }
  /// Offsets, in voxels, of x and of y: -reach() .. reach().
  [[nodiscard]] std::int32_t reach() const { return reach_; }
  /// @return null if there is no direction
  [[nodiscard]] const kernels::DirectionMask* at(std::int32_t dx, std::int32_t dy) const {
    return kernels::CorridorView{table_.data(), reach_}.at(dx, dy);
  }
  [[nodiscard]] std::span<const kernels::DirectionMask> table() const { return table_; }  ///< [x][y]
  [[nodiscard]] std::uint64_t bytes() const { return table_.capacity() * sizeof(table_[0]); }

 private:
  std::int32_t reach_ = 0;
  std::vector<kernels::DirectionMask> table_;  ///< [x][y]
};

}  // namespace accessvdb::internal
