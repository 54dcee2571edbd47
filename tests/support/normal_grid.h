// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The grid of directions that normals are rounded to, a second time, in double and by search.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>

namespace accessvdb::test {

/// The grid point of a direction: on the cube's face that the direction meets, the one nearest to that place.
/// @param steps  from the middle of a face to its edge
/// @return none if the place lies within `slack` steps of the middle between two grid points: a rounded direction may
///   be on either side
inline std::optional<Eigen::Vector3i> gridPoint(const Eigen::Vector3d& direction, int steps, double slack) {
  const Eigen::Vector3d place = direction / direction.lpNorm<Eigen::Infinity>() * steps;
  Eigen::Vector3i nearest = Eigen::Vector3i::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    for (int n = -steps; n <= steps; ++n) {
      const double distance = std::abs(place[axis] - n), least = std::abs(place[axis] - nearest[axis]);
      if (std::abs(distance - 0.5) < slack) return std::nullopt;
      if (distance < least) nearest[axis] = n;
    }
  }
  return nearest;
}

}  // namespace accessvdb::test
