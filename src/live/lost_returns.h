// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the returns of scans lay that there was no time for, in bounded memory: cubes of the world, which double in
/// size when there are too many.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <set>
#include <vector>

namespace accessvdb::internal {

class LostReturns {
 public:
  static constexpr std::size_t kMostCubes = std::size_t{1} << 15;

  /// @param edge_m  of the first cubes
  explicit LostReturns(double edge_m) : edge_m_(edge_m) {}

  /// Positions that are not finite are no returns. @param spread_m  the return may lie so far from there
  void add(const Eigen::Vector3d& p_W, double spread_m = 0);
  /// They may lie anywhere.
  void addEverywhere() { everywhere_ = true; }
  [[nodiscard]] bool everywhere() const { return everywhere_; }
  [[nodiscard]] bool empty() const { return cubes_.empty() && !everywhere_; }
  /// Every return lay at most radius_m() from one of these.
  [[nodiscard]] std::vector<Eigen::Vector3d> centres_W() const;
  [[nodiscard]] double radius_m() const { return 0.8661 * edge_m_ + spread_m_; }  // half a diagonal, rounded up

 private:
  using Cube = std::array<std::int64_t, 3>;
  double edge_m_, spread_m_ = 0;
  std::set<Cube> cubes_;
  bool everywhere_ = false;
};

}  // namespace accessvdb::internal
