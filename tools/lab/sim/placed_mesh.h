// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A mesh placed upright somewhere: many trees from a few meshes.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace accessvdb::sim {

/// p_W = Rz(yaw_rad) p + offset_W.
struct PlacedMesh {
  std::uint32_t mesh = 0;  ///< index into the accompanying meshes
  double yaw_rad = 0;
  Eigen::Vector3d offset_W = {0, 0, 0};  ///< metres
};

}  // namespace accessvdb::sim
