// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Turns the numbers of pose files into rigid transforms, or refuses them naming the line.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <string>
#include <vector>

namespace accessvdb::io {

/// Limit of silent repair: arithmetic rounding.
inline constexpr double kQuaternionSilent = 1e-6;
/// Limit of silent repair: text of 6 or 7 digits, as KITTI and BALM write, with some margin.
inline constexpr double kRotationSilent = 1e-4;
/// Limit of repair with a notice; refused beyond.
inline constexpr double kRepairLimit = 1e-2;

/// Checks and repairs; counts the repairs for one notice per file.
class PoseChecker {
 public:
  explicit PoseChecker(std::string subject) : subject_(std::move(subject)) {}

  /// @param q     w x y z, any length
  /// @param line  for messages; 0 = no line
  /// @throws UnusableInput "poses.non_finite", "poses.bad_quaternion"
  Eigen::Isometry3d fromQuaternion(const Eigen::Vector3d& t, const Eigen::Vector4d& q, std::size_t line);
  /// @param m  [R t]; R is replaced by the nearest rotation
  /// @throws UnusableInput "poses.non_finite", "poses.bad_rotation"
  Eigen::Isometry3d fromMatrix(const Eigen::Matrix<double, 3, 4>& m, std::size_t line);

  /// Adds one line about repairs, if any.
  void addNotice(std::vector<std::string>& notices) const;

 private:
  void requireFinite(bool finite, std::size_t line) const;
  void repaired(double error, std::size_t line);
  [[nodiscard]] std::string where(std::size_t line) const;

  std::string subject_;
  std::uint64_t repairs_ = 0;
  double worst_ = 0;
  std::size_t first_line_ = 0;
};

}  // namespace accessvdb::io
