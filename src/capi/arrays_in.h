// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points and poses out of a caller's arrays.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <span>

#include "capi/boundary.h"

namespace accessvdb::capi {

// Arrays of three numbers are read as Eigen's vectors in place.
static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float) && alignof(Eigen::Vector3f) == alignof(float));
static_assert(sizeof(Eigen::Vector3d) == 3 * sizeof(double) && alignof(Eigen::Vector3d) == alignof(double));

/// @param xyz  [3 x count]  @throws InvalidArgument as requireArray()
template <typename Scalar>
auto vectors(const char* name, const Scalar* xyz, std::size_t count) {
  using Vector = Eigen::Matrix<Scalar, 3, 1>;
  requireArray(name, xyz, count, sizeof(Vector), alignof(Scalar));
  return std::span<const Vector>(reinterpret_cast<const Vector*>(xyz), count);
}

/// @param T_W_S  [16] row-major  @throws InvalidArgument as requireArray(); UnusableInput "pose.last_row"
[[nodiscard]] Eigen::Isometry3d poseFromC(const double* T_W_S);

}  // namespace accessvdb::capi
