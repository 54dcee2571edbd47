// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/arrays_in.h"

namespace accessvdb::capi {

Eigen::Isometry3d poseFromC(const double* T_W_S) {
  requireArray("T_W_S", T_W_S, 16, sizeof(double), alignof(double));
  Eigen::Isometry3d pose;
  pose.matrix() = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(T_W_S);
  if (pose.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    if (!pose.matrix().allFinite()) {
      throw UnusableInput("pose.last_row", "T_W_S", "the pose is not finite",
                          "Leave out scans whose pose is not known");
    }
    throw UnusableInput("pose.last_row", "T_W_S", "the last row of a pose is not 0 0 0 1",
                        "Pass the matrix row by row; in a transposed one the position is there");
  }
  return pose;
}

}  // namespace accessvdb::capi
