// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/poses/pose_checks.h"

#include <Eigen/SVD>
#include <cmath>
#include <cstdio>

#include "accessvdb/error.h"

namespace accessvdb::io {
namespace {

/// Rounding of what was meant to be zero.
constexpr double kZero = 1e-6;
/// A rotation in double precision is off by less. It stays as it is, so that poses that were written with all digits
/// are read back with the same bits.
constexpr double kRounding = 1e-14;

std::string shortNumber(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.3g", value);
  return text;
}

}  // namespace

void warnOfFarExtrinsic(const Eigen::Vector3d& p_B, const std::string& what, std::vector<ScanWarning>& warnings) {
  if (!(p_B.norm() > kFarExtrinsic_m)) return;
  warnings.push_back({"poses.extrinsic", what + " puts the sensor " + shortNumber(p_B.norm()) +
                                             " m from what the poses are of: check that it is in metres, and the pose "
                                             "of the sensor on the platform"});
}

std::string PoseChecker::where(std::size_t line) const {
  return line == 0 ? std::string("the pose") : "line " + std::to_string(line);
}

void PoseChecker::requireFinite(bool finite, std::size_t line) {
  found_none_ = !finite;
  if (!finite)
    throw UnusableInput("poses.non_finite", subject_, where(line) + " has a value that is not finite",
                        "Remove or correct that pose");
}

void PoseChecker::repaired(double error, std::size_t line) {
  if (repairs_ == 0) first_line_ = line;
  ++repairs_;
  worst_ = std::max(worst_, error);
}

Eigen::Isometry3d PoseChecker::fromQuaternion(const Eigen::Vector3d& t, const Eigen::Vector4d& q, std::size_t line) {
  requireFinite(t.allFinite() && q.allFinite(), line);
  const double error = std::abs(q.norm() - 1.0);
  found_none_ = q.norm() <= kZero;
  if (!(error <= kRepairLimit))
    throw UnusableInput("poses.bad_quaternion", subject_,
                        where(line) + " has a quaternion of length " + shortNumber(q.norm()) + ", not 1",
                        "Check the order of the columns and the pose format");
  if (error > kQuaternionSilent) repaired(error, line);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
  pose.translation() = t;
  return pose;
}

Eigen::Isometry3d PoseChecker::fromMatrix(const Eigen::Matrix<double, 3, 4>& m, std::size_t line) {
  requireFinite(m.allFinite(), line);
  const Eigen::Matrix3d r = m.leftCols<3>();
  found_none_ = r.norm() <= kZero;
  const double error = (r.transpose() * r - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(error <= kRepairLimit) || !(r.determinant() > 0))
    throw UnusableInput("poses.bad_rotation", subject_,
                        where(line) + " has a matrix that is not a rotation (off by " + shortNumber(error) +
                            ", determinant " + shortNumber(r.determinant()) + ")",
                        "Check the order of the numbers and the pose format");
  if (error > kRotationSilent) repaired(error, line);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = r;
  if (error > kRounding) {
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
    pose.linear() = svd.matrixU() * svd.matrixV().transpose();
  }
  pose.translation() = m.col(3);
  return pose;
}

void PoseChecker::addNotice(std::vector<std::string>& notices) const {
  if (repairs_ == 0) return;
  notices.push_back(subject_ + ": " + std::to_string(repairs_) +
                    " rotations were not exactly unit and have been normalised (worst off by " + shortNumber(worst_) +
                    ", first in " + where(first_line_) + ")");
}

}  // namespace accessvdb::io
