// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Clouds and meshes of the scene as bytes, made by hand so that they can be wrong.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "inputs/field_world.h"
#include "support/bytes.h"

namespace accessvdb::inputs_test {

using test::put;

/// A return with what LAS says about it.
struct LasReturn {
  Eigen::Vector3d p;
  double time = 0;
  std::uint8_t flags = 0, point_class = 1;  ///< flags as in formats 6 to 10: 1 synthetic, 2 key point, 4 withheld
};

/// LAS 1.2 or, with formats 6 to 10, 1.4.
struct LasFile {
  int format = 1;
  double scale = 1e-4, z_scale = 1e-4;
  std::uint16_t global_encoding = 0;
  std::vector<std::pair<int, std::string>> projection = {};  ///< their records
  bool extended = false;                                     ///< they are behind the points
  std::string user = "LASF_Projection";                      ///< of the records
  [[nodiscard]] std::string bytes(const std::vector<LasReturn>& returns) const;
};

/// GeoKeys with short values.
[[nodiscard]] std::string geoKeys(const std::vector<std::pair<int, int>>& values);

/// The returns of all scans in the world frame, and where the sensor was, as lines "time x y z".
/// @param unit_m  metres in a unit of both
[[nodiscard]] std::vector<LasReturn> walkReturns(const std::vector<WorldScan>& scans, double unit_m = 1);
[[nodiscard]] std::string walkLines(const std::vector<WorldScan>& scans, double unit_m = 1);

/// A box of 0.6 x 0.06 x 0.06 m with its tip at the origin: twelve faces as binary STL, or as text.
[[nodiscard]] std::string boxStl(const std::string& header = "");
[[nodiscard]] std::string boxStlText(const std::string& line_end = "\n");

}  // namespace accessvdb::inputs_test
