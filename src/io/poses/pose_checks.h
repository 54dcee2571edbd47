// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Turns the numbers of pose files into rigid transforms, or refuses them naming the line.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

#include "accessvdb/scan_io.h"

namespace accessvdb::io {

/// Limit of silent repair: arithmetic rounding.
inline constexpr double kQuaternionSilent = 1e-6;
/// Limit of silent repair: text of 6 or 7 digits, as KITTI and BALM write, with some margin.
inline constexpr double kRotationSilent = 1e-4;
/// Limit of repair with a notice; refused beyond.
inline constexpr double kRepairLimit = 1e-2;

/// Whether this is the same pose written twice.
[[nodiscard]] inline bool isSamePose(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  constexpr double kRounding = 1e-9;
  return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff() <= kRounding;
}

/// A sensor this far from what the poses are of is on another vehicle, or in another unit.
inline constexpr double kFarExtrinsic_m = 5;
/// Adds "poses.extrinsic" for such a sensor. @param what  says where it is: "T_B_S"
void warnOfFarExtrinsic(const Eigen::Vector3d& p_B, const std::string& what, std::vector<ScanWarning>& warnings);

/// Checks and repairs; counts the repairs for one notice per file.
class PoseChecker {
 public:
  explicit PoseChecker(std::string subject) : subject_(std::move(subject)) {}

  /// @param q     w x y z, any length
  /// @param line  for messages; 0 = no line
  /// @throws UnusableInput "poses.non_finite", "poses.bad_quaternion"
  Eigen::Isometry3d fromQuaternion(const Eigen::Vector3d& t, const Eigen::Vector4d& q, std::size_t line);
  /// @param m  [R t]; R is replaced by the nearest rotation, unless it is one but for rounding
  /// @throws UnusableInput "poses.non_finite", "poses.bad_rotation"
  Eigen::Isometry3d fromMatrix(const Eigen::Matrix<double, 3, 4>& m, std::size_t line);

  /// Whether the last error was of what is no pose at all: zero or not finite, as programs write where they have none.
  [[nodiscard]] bool foundNone() const { return found_none_; }
  /// Adds one line about repairs, if any.
  void addNotice(std::vector<std::string>& notices) const;

 private:
  void requireFinite(bool finite, std::size_t line);
  void repaired(double error, std::size_t line);
  [[nodiscard]] std::string where(std::size_t line) const;

  std::string subject_;
  bool found_none_ = false;
  std::uint64_t repairs_ = 0;
  double worst_ = 0;
  std::size_t first_line_ = 0;
};

}  // namespace accessvdb::io
