// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writing points.las: LAS 1.4, point format 7, with what a point's columns in points.ply say as extra bytes.
/// Source: ASPRS LAS specification 1.4 R15.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <iosfwd>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "accessvdb/surface_points.h"
#include "accessvdb/survey_frame.h"
#include "accessvdb/types.h"

namespace accessvdb::internal {

/// Where coordinates are stored: in the unit of the frame, in steps from the field's origin.
struct LasGrid {
  Eigen::Vector3d unit_m = {1, 1, 1};
  Eigen::Vector3d origin = {0, 0, 0};  ///< in units
  Eigen::Vector3d scale = {0, 0, 0};   ///< of a step, in units; no more than 0.1 mm
  LasGrid(const Eigen::Vector3d& origin_W, const SurveyFrame& frame);
  /// @throws OutputError "output.las_range"
  [[nodiscard]] std::int32_t steps(double x_W, int axis) const;
};

/// What the header says of all points.
struct LasContent {
  Eigen::Vector3d origin_W;      ///< coordinates are stored relative to it, world frame, metres
  Eigen::Vector3d min_W, max_W;  ///< bounds of the points
  std::uint64_t points = 0;
  std::vector<std::string> carried = {};  ///< names of what the returns carried
  SurveyFrame frame = {};
  bool margins = false;      ///< SurfacePoints::hasMargins()
  bool probability = false;  ///< SurfacePoints::hasProbability()

  /// Bytes of a point behind LAS's own and kColumns.
  [[nodiscard]] std::size_t furtherBytes() const {
    return (carried.size() + (margins ? 2 : 0) + (probability ? 1 : 0)) * 4;
  }
};

/// Writes the points one after the other.
class LasWriter {
 public:
  /// Writes the header and its records.
  LasWriter(std::ostream& stream, const LasContent& content);
  /// @throws OutputError "output.las_range" for a point farther from the origin than LAS can store, 214 km
  using FirstReturn = SurfacePoints::FirstReturn;
  /// @param carried  [LasContent::carried]
  void add(const SurfacePoint& point, std::span<const std::int32_t> carried, const std::optional<FirstReturn>& first);

 private:
  std::ostream& stream_;
  LasGrid grid_;
  bool margins_, probability_;
  std::optional<std::size_t> class_;  ///< which of the carried values is the point's class
};

}  // namespace accessvdb::internal
