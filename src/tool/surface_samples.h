// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points spread over a mesh's surface, the same on every machine.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace accessvdb::internal {

/// [count] points, uniform by area, from a fixed seed. Frame and unit of the vertices.
std::vector<Eigen::Vector3d> sampleSurface(const std::vector<Eigen::Vector3f>& vertices,
                                           const std::vector<std::array<std::uint32_t, 3>>& triangles, int count);

}  // namespace accessvdb::internal
