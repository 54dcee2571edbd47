// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// views.json, views.csv and views.ply.
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>

#include "accessvdb/field_io.h"
#include "accessvdb/next_views.h"
#include "io/results/pose_numbers.h"
#include "io/results/pyramids_ply.h"

namespace accessvdb::io {
namespace {

using Json = nlohmann::ordered_json;

/// More digits than a prediction has.
double tenths(double value) { return std::round(value * 10) / 10; }

std::string viewsCsv(const NextViews& found) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.precision(12);
  text << "view,resolves,of_confidence,of_unseen,of_unknown,travel_m,way_is_free,x,y,z,qw,qx,qy,qz\n";
  for (std::size_t n = 0; n < found.views.size(); ++n) {
    const NextView& view = found.views[n];
    text << n << "," << tenths(view.resolves) << "," << tenths(view.of_confidence) << "," << tenths(view.of_unseen)
         << "," << tenths(view.of_unknown) << "," << view.travel_m << "," << (view.way_is_free ? 1 : 0);
    for (const double number : internal::poseNumbers(view.T_W_S)) text << "," << number;
    text << "\n";
  }
  return text.str();
}

/// A pyramid for each view, with its tip at the sensor, opening along the sensor's x axis: the first green, the others
/// grey.
void writeViewsPly(std::ostream& stream, const NextViews& found) {
  std::vector<internal::Pyramid> pyramids;
  double size_m = 0.3;
  for (const NextView& view : found.views) {
    if (view.travel_m > 0) size_m = std::min(size_m, 0.3 * view.travel_m);
  }
  for (const NextView& view : found.views) {
    const Eigen::Vector3d tip_W = view.T_W_S.translation();
    pyramids.push_back({tip_W, tip_W + size_m * view.T_W_S.linear().col(0), view.T_W_S.linear(), 0.5 * size_m,
                        pyramids.empty() ? PointLabel::Accessible : PointLabel::Unscored,
                        static_cast<std::int32_t>(pyramids.size())});
  }
  internal::writePyramids(stream, pyramids, "view");
}

}  // namespace

std::string viewsJson(const NextViews& found) {
  Json json = {
      {"unresolved_points", {{"confidence", found.confidence}, {"unseen", found.unseen}, {"unknown", found.unknown}}},
      {"poses_compared", found.tried},
      {"views", Json::array()}};
  for (const NextView& view : found.views) {
    json["views"].push_back({{"pose", internal::poseJson(view.T_W_S)},
                             {"resolves", tenths(view.resolves)},
                             {"of_confidence", tenths(view.of_confidence)},
                             {"of_unseen", tenths(view.of_unseen)},
                             {"of_unknown", tenths(view.of_unknown)},
                             {"travel_m", view.travel_m},
                             {"way_is_free", view.way_is_free},
                             {"why", view.why}});
  }
  return json.dump(2) + "\n";
}

void writeViews(const std::filesystem::path& folder, const NextViews& found) {
  writeFileDurably(folder / "views.json", [&](std::ostream& stream) { stream << viewsJson(found); });
  writeFileDurably(folder / "views.csv", [&](std::ostream& stream) { stream << viewsCsv(found); });
  writeFileDurably(folder / "views.ply", [&](std::ostream& stream) { writeViewsPly(stream, found); });
}

}  // namespace accessvdb::io
