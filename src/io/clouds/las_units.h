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
  bool repeated = false;                        ///< two records of one kind differ: the first is here
};

/// What of it can be said again in points.las: what can be read, and does not contradict what counts.
struct LasSystem {
  bool wkt = false, keys = false;
  std::string doubt = {};  ///< why something is not, or may be wrong, in words; empty if there is nothing
};
[[nodiscard]] LasSystem lasSystem(const LasProjection& projection);
/// The text of its WKT, without the zero that ends it and what is behind.
[[nodiscard]] std::string wktText(const LasProjection& projection);

/// @throws InputError "input.geographic" (longitude and latitude, or from the Earth's centre), "input.unit" (another
/// unit than metres and feet)
[[nodiscard]] LasUnits lasUnits(const LasProjection& projection, const std::string& subject);

}  // namespace accessvdb::io
