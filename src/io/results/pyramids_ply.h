// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Slender pyramids as a PLY mesh: arrows of approaches, views of the sensor.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <iosfwd>
#include <vector>

#include "accessvdb/point_label.h"

namespace accessvdb::internal {

struct Pyramid {
  Eigen::Vector3d tip_W, base_W;  ///< base_W: middle of its base
  Eigen::Matrix3d R_W;            ///< the base is square to y and z
  double half_m;                  ///< half the base's edge
  PointLabel colour;
  std::int32_t number;
};

/// @param number_name  of the property with Pyramid::number
void writePyramids(std::ostream& stream, const std::vector<Pyramid>& pyramids, const char* number_name);

}  // namespace accessvdb::internal
