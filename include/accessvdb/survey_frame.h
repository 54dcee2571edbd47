// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The coordinate system of a cloud in the world frame, as its LAS file says it, so that points.las can say the same.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "accessvdb/export.h"

namespace accessvdb {

struct ACCESSVDB_API SurveyFrame {
  std::string wkt = {};                                         ///< well-known text, without a zero at its end
  std::string geo_keys = {}, geo_doubles = {}, geo_texts = {};  ///< GeoTIFF records 34735 to 34737, byte by byte
  bool wkt_counts = false;                                      ///< where there are both
  Eigen::Vector3d unit_m = {1, 1, 1};                           ///< metres in one unit of x, y and z
  std::uint16_t year = 0, day = 0;                              ///< of the first file; 0: not said
  bool adjusted_gps_time = false;  ///< times of points are GPS seconds less 1e9, not of the week
  bool first_returns = false;      ///< returns carry their GPS time and class (kFirstReturnNames), for points.las

  [[nodiscard]] bool hasSystem() const { return !wkt.empty() || !geo_keys.empty(); }
  /// Of what the file says of the system; empty without one. Files of one program say the same system with the same
  /// bytes; what differs may be the same in other words, or another datum some metres away, which nothing else shows.
  [[nodiscard]] std::string systemSha256() const;
};

/// What returns carry for points.las alone: the halves of the GPS time's 64 bits, low first, and the class. As names of
/// CarriedAttribute they are no columns of other files.
inline constexpr const char* kFirstReturnNames[] = {"@time_low", "@time_high", "@class"};

}  // namespace accessvdb
