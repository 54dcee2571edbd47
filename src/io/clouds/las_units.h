// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a LAS file says about its coordinates: GeoKeys (VLR 34735, with texts in 34737) or WKT (VLR 2112), of which
/// the header says which counts.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::io {

struct LasUnits {
  Eigen::Vector3d metres = {1, 1, 1};  ///< in one unit of x, y and z
  std::string words = {};              ///< "US survey feet"; empty for metres
  std::string doubt = {};              ///< what could not be read, in words
};

/// The records that say it, as they are in the file; empty where there is none.
struct LasProjection {
  std::optional<std::string> geo_keys = {}, geo_doubles = {}, geo_texts = {}, wkt = {};
  std::optional<std::string> extra_bytes = {};  ///< says what is behind the dimensions of a point: no projection
  bool wkt_counts = false;                      ///< bit 4 of the header's global encoding
  bool cut_off = false;                         ///< the list of records ends inside of one
};

/// @throws InputError "input.geographic" (longitude and latitude, or from the Earth's centre), "input.unit" (another
/// unit than metres and feet)
[[nodiscard]] LasUnits lasUnits(const LasProjection& projection, const std::string& subject);

}  // namespace accessvdb::io
