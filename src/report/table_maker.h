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
#include "report/field_folder.h"

namespace accessvdb::internal {

/// Classes and trees have rows. `scan` and `index` say where a point's return is: they would have one for each point.
[[nodiscard]] bool hasRows(const std::string& attribute);

class TableMaker {
 public:
  explicit TableMaker(const FieldFolder& folder);

  /// @param carried  [attributes]
  /// @return the steps of ExactArea that the point stands for
  std::uint64_t add(const SurfacePoint& point, std::span<const std::int32_t> carried);
  [[nodiscard]] io::PointTable finish() const;

 private:
  Eigen::Vector3d origin_W_;
  double voxel_size_m_;
  double cell_m_;  ///< io::pointCell_m()
  std::vector<std::string> names_, tools_;
  std::vector<std::size_t> columns_;  ///< of the names, in what points carry
  io::PointRow whole_;
  std::vector<std::unordered_map<std::int32_t, io::PointRow>> rows_;  ///< [names]
};

}  // namespace accessvdb::internal
