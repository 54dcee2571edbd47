// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Distances to the nearest obstacle beyond the map's own tau, for planners that optimise.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

class AccessibilityField;

/// A box of the map's voxels.
struct DistanceGrid {
  Eigen::Vector3d first_W = {0, 0, 0};  ///< centre of the first voxel, world frame, metres
  double voxel_size_m = 0;
  std::array<std::size_t, 3> size = {0, 0, 0};
  /// [size[0] x size[1] x size[2]] metres from a voxel's centre to that of the nearest voxel that collides (it was
  /// observed closer than r_c to a surface, or a return was left out there), exact up to most_m, which stands for all
  /// beyond. 0 where it collides itself.
  std::vector<float> distance_m;
  /// [as distance_m] 1: the voxel was observed or cleared. Where it is 0, an obstacle may be anywhere: what is unknown
  /// is told apart, and is not free.
  std::vector<std::uint8_t> known;
  double most_m = 0;

  [[nodiscard]] std::size_t index(std::size_t x, std::size_t y, std::size_t z) const {
    return (x * size[1] + y) * size[2] + z;
  }
};

/// @param low_W, high_W  the box, world frame, metres; rounded outwards to voxels
/// @param most_m  how far obstacles count, also those outside the box
/// @throws InvalidArgument "distance.box" (not finite, empty, outside the map's range), "distance.range" (most_m below
/// a voxel); ResourceLimit "distance.size" (the box with most_m around it has more than 2^27 voxels, or most_m is more
/// than 512 of them)
[[nodiscard]] ACCESSVDB_API DistanceGrid distanceGrid(const AccessibilityField& field, const Eigen::Vector3d& low_W,
                                                      const Eigen::Vector3d& high_W, double most_m);

}  // namespace accessvdb
