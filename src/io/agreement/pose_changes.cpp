// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/agreement/pose_changes.h"

#include <numbers>

namespace accessvdb::io {
namespace {

constexpr double kTurns_deg[] = {5, 10, 15, 20, 25, 30, 45, 60, 90, 135};
constexpr double kOffsets_s[] = {0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.5, 1};
/// Positions of poses in millimetres, centimetres, feet, inches, and scans in those.
constexpr double kPoseUnits[] = {0.001, 0.01, 0.0254, 0.3048, 1000, 100, 1 / 0.0254, 1 / 0.3048};

}  // namespace

std::vector<PoseCure> poseChanges() {
  std::vector<PoseCure> changes;
  for (const PoseFault fault :
       {PoseFault::QuaternionWFirst, PoseFault::QuaternionWLast, PoseFault::Inverse, PoseFault::InverseExtrinsic})
    changes.push_back({fault});
  for (int axis = 0; axis < 3; ++axis) {
    for (const double turn : kTurns_deg) {
      changes.push_back({PoseFault::Turned, axis, turn});
      changes.push_back({PoseFault::Turned, axis, -turn});
    }
    changes.push_back({PoseFault::Turned, axis, 180});
  }
  for (const double offset : kOffsets_s) {
    changes.push_back({PoseFault::TimeOffset, 0, offset});
    changes.push_back({PoseFault::TimeOffset, 0, -offset});
  }
  for (const double unit : kPoseUnits) changes.push_back({PoseFault::Unit, 0, unit});
  return changes;
}

Eigen::Isometry3d changedPose(const PoseCure& change, const Eigen::Isometry3d& T_W_B, const Eigen::Isometry3d& T_B_S) {
  Eigen::Isometry3d T = T_W_B;
  switch (change.fault) {
    case PoseFault::QuaternionWFirst: {
      const Eigen::Quaterniond read(T_W_B.linear());
      T.linear() = Eigen::Quaterniond(read.x(), read.y(), read.z(), read.w()).toRotationMatrix();
      return T * T_B_S;
    }
    case PoseFault::QuaternionWLast: {
      const Eigen::Quaterniond read(T_W_B.linear());
      T.linear() = Eigen::Quaterniond(read.z(), read.w(), read.x(), read.y()).toRotationMatrix();
      return T * T_B_S;
    }
    case PoseFault::Inverse:
      return T_W_B.inverse() * T_B_S;
    case PoseFault::InverseExtrinsic:
      return T_W_B * T_B_S.inverse();
    case PoseFault::Turned: {
      const Eigen::Vector3d axis = Eigen::Vector3d::Unit(change.axis);
      return T_W_B * T_B_S * Eigen::AngleAxisd(change.value * std::numbers::pi / 180, axis);
    }
    case PoseFault::Unit:
      T.translation() *= change.value;
      return T * T_B_S;
    case PoseFault::None:
    case PoseFault::InWorld:
    case PoseFault::TimeOffset:
      break;
  }
  return T_W_B * T_B_S;
}

}  // namespace accessvdb::io
