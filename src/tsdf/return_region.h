// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The rays of returns, and the region that a map's parameters give them (hostdev/return_leaves.h).
#pragma once

#include "accessvdb/params.h"
#include "hostdev/return_leaves.h"

namespace accessvdb::internal {

using kernels::Interval, kernels::kOwnVoxelRadius, kernels::kSlack, kernels::ReturnRay;

/// The ray of a return. Rounded only where its parts are stored.
/// @param p_L, q_L  [3] return and sensor, local frame, metres
ReturnRay makeRay(const float* p_L, const float* q_L, double voxel_size_m);

/// Stands for a sensor position. @param q_L  [3] local frame, metres
ReturnRay ballAround(const float* q_L, double voxel_size_m);

/// The update region of a map.
struct RegionShape : kernels::RegionConstants {
  explicit RegionShape(const TsdfParams& resolved);
};

}  // namespace accessvdb::internal
