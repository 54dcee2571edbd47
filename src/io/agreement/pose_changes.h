// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The ways in which poses are usually wrong, undone: what they would be if that had happened.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "accessvdb/program/scan_agreement.h"

namespace accessvdb::io {

/// Every change that is tried, apart from PoseFault::InWorld, which changes the points.
[[nodiscard]] std::vector<PoseCure> poseChanges();

/// @param T_W_B  as given, of the time that PoseFault::TimeOffset asks for  @param T_B_S  as given
[[nodiscard]] Eigen::Isometry3d changedPose(const PoseCure& change, const Eigen::Isometry3d& T_W_B,
                                            const Eigen::Isometry3d& T_B_S);

}  // namespace accessvdb::io
