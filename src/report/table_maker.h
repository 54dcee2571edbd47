// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Adds up a table of points, in any order.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "accessvdb/program/point_table.h"

namespace accessvdb::internal {

class TableMaker {
 public:
  /// @param origin_W  of the map  @param attributes  names of what points carry
  TableMaker(const Eigen::Vector3d& origin_W, double voxel_size_m, std::vector<std::string> attributes);

  /// @param carried  [attributes]
  /// @return the steps of ExactArea that the point stands for
  std::uint64_t add(const SurfacePoint& point, std::span<const std::int32_t> carried);
  [[nodiscard]] io::PointTable finish() const;

 private:
  Eigen::Vector3d origin_W_;
  double voxel_size_m_;
  std::vector<std::string> names_;
  io::PointRow whole_;
  std::vector<std::unordered_map<std::int32_t, io::PointRow>> rows_;  ///< [attributes]
};

}  // namespace accessvdb::internal
