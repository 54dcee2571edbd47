// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where to look next: poses of the sensor from which what is missing of points would come.
///
///   for (const accessvdb::NextView& view : accessvdb::nextViews(field, {.from_W = position_W}).views)
///     fly(view.T_W_S);
///
/// A point is unresolved while its reason is confidence, unseen or unknown: it was seen too rarely or from the wrong
/// side, or nothing is known of the space in front of it. A view resolves it if it brings what is missing, so that the
/// tool can be tried: then it is accessible, or blocked by what was seen.
///
/// Views are found by casting the sensor's field of view through the map as it is. Surfaces that no scan has met are in
/// no prediction: they come on top of it, and what they hide is taken off it.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb {

class AccessibilityField;

/// What the sensor measures from a place. Its frame: x forward, y left, z up. The defaults are a Livox Mid-360 that
/// stands level and stays for a second.
struct ViewSensor {
  double azimuth_rad = 2 * std::numbers::pi;        ///< whole width of the view, half of it to either side of x
  double elevation_min_rad = -0.12217304763960307;  ///< -7 degrees; above the sensor's x-y plane is positive
  double elevation_max_rad = 0.9075712110370514;    ///< 52 degrees
  std::vector<double> pitches_rad = {0};            ///< how it can be held: angles of x above level
  double rays = 200000;                             ///< of one view, spread evenly over azimuth and elevation
  double max_range_m = std::numeric_limits<double>::infinity();  ///< beyond the field's own, that one counts
};

struct ViewOptions {
  std::size_t most = 5;  ///< views
  ViewSensor sensor = {};
  double body_radius_m = 0;  ///< what carries the sensor: a ball around it; 0 = rule: TsdfParams::platform_radius_m,
                             ///< 0.3 without it
  std::optional<Eigen::Vector3d> from_W =
      std::nullopt;  ///< where the sensor is; without it, the first way costs nothing
  double within_m = std::numeric_limits<double>::infinity();  ///< of from_W
  /// The way that is worth one view: of two views, one that is so much farther away has to resolve twice as much.
  /// Infinity: ways cost nothing. 0 = rule: 10 m.
  double travel_m = 0;
};

/// A place for the sensor, and what to expect there after the views before it.
struct NextView {
  Eigen::Isometry3d T_W_S = Eigen::Isometry3d::Identity();  ///< world from sensor
  double resolves = 0;                                      ///< points, expected
  double of_confidence = 0, of_unseen = 0, of_unknown = 0;  ///< of these, by the reason that they have now
  double travel_m = 0;                                      ///< from the view before, or from from_W; 0 without one
  /// Whether the straight way from there is known to be free for the body.
  bool way_is_free = false;
  std::string why;  ///< in words
};

struct NextViews {
  std::vector<NextView> views;                            ///< in the order in which to go to them
  std::uint64_t confidence = 0, unseen = 0, unknown = 0;  ///< unresolved points by reason
  std::uint64_t tried = 0;                                ///< poses that were compared
  [[nodiscard]] std::uint64_t unresolved() const { return confidence + unseen + unknown; }
};

/// Never a pose at which the body collides, or is not known to be free. The same field gives the same views, on any
/// backend. What a view resolves is expected from at most 2048 of the unresolved points, taken evenly.
/// @throws InvalidArgument "views.options", "views.field_of_view"; UnusableInput "views.no_map" (no scan),
/// "views.none_missing" (nothing is unresolved), "views.no_free_space" (nowhere is the body known to be free)
[[nodiscard]] ACCESSVDB_API NextViews nextViews(const AccessibilityField& field, const ViewOptions& options = {});

namespace io {

/// views.json, views.csv (one row per view) and views.ply (a small pyramid at each pose, which opens along the sensor's
/// x axis). @throws OutputError
ACCESSVDB_API void writeViews(const std::filesystem::path& folder, const NextViews& found);
/// The content of views.json.
[[nodiscard]] ACCESSVDB_API std::string viewsJson(const NextViews& found);

}  // namespace io
}  // namespace accessvdb
