// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// approaches.json, approaches.csv and approaches.ply.
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>

#include "accessvdb/approaches.h"
#include "accessvdb/attributes.h"
#include "accessvdb/field_io.h"
#include "io/results/pose_numbers.h"
#include "io/results/pyramids_ply.h"

namespace accessvdb::io {
namespace {

using Json = nlohmann::ordered_json;

/// As few digits as a float32 has.
double shortened(float value) { return std::round(static_cast<double>(value) * 1e6) / 1e6; }

std::string nameOf(const ApproachTarget& target, const std::vector<std::string>& tools) {
  return target.tool < tools.size() ? tools[target.tool] : std::to_string(target.tool);
}

Json jsonOf(const ApproachPath& path) {
  return {{"pre_contact", internal::poseJson(path.pre_contact_T_WT)},
          {"contact", internal::poseJson(path.contact_T_WT)},
          {"retreat", internal::poseJson(path.retreat_T_WT)},
          {"direction", path.direction},
          {"roll", path.roll},
          {"collisions", path.collisions},
          {"free_arc_deg", path.free_arc_deg < 0 ? Json(nullptr) : Json(shortened(path.free_arc_deg))},
          {"seen_free_m", path.seen_free_m}};
}

std::string csvOf(const Approaches& found, const std::vector<std::string>& tools) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.precision(12);
  text << "target,approach,point,tool,margin_m,free_arc_deg,confidence,collisions,seen_free_m";
  for (const char* pose : {"pre_contact", "contact", "retreat"})
    for (const char* part : {"x", "y", "z", "qw", "qx", "qy", "qz"}) text << "," << pose << "_" << part;
  text << ",access_probability\n";  // last: whoever reads by number finds the others where they were
  for (std::size_t n = 0; n < found.targets.size(); ++n) {
    const ApproachTarget& target = found.targets[n];
    for (std::size_t k = 0; k < target.approaches.size(); ++k) {
      const ApproachPath& path = target.approaches[k];
      text << n << "," << k << "," << target.point << "," << nameOf(target, tools) << "," << shortened(target.margin_m)
           << "," << shortened(path.free_arc_deg) << "," << shortened(target.confidence) << "," << path.collisions
           << "," << path.seen_free_m;
      for (const Eigen::Isometry3d& T_WT : {path.pre_contact_T_WT, path.contact_T_WT, path.retreat_T_WT})
        for (const double number : internal::poseNumbers(T_WT)) text << "," << number;
      text << "," << shortened(target.access_probability) << "\n";
    }
  }
  return text.str();
}

/// A slender pyramid for each approach, from the pre-contact pose to the point, which is its tip: the first of a target
/// green, the others grey.
void writeArrows(std::ostream& stream, const Approaches& found) {
  std::vector<internal::Pyramid> arrows;
  std::int32_t number = 0;
  for (const ApproachTarget& target : found.targets) {
    bool first = true;
    for (const ApproachPath& path : target.approaches) {
      const Eigen::Vector3d tip_W = path.contact_T_WT.translation(), base_W = path.pre_contact_T_WT.translation();
      arrows.push_back({tip_W, base_W, path.contact_T_WT.linear(), 0.04 * (base_W - tip_W).norm(),
                        first ? PointLabel::Accessible : PointLabel::Unscored, number});
      first = false;
    }
    ++number;
  }
  internal::writePyramids(stream, arrows, "target");
}

}  // namespace

std::string approachesJson(const Approaches& found, const std::vector<std::string>& tools) {
  Json json = {{"accessible_points", found.accessible},
               {"covered_points", found.covered},
               {"tried_without_way", found.without_way},
               {"targets", Json::array()}};
  for (const ApproachTarget& target : found.targets) {
    Json one = {{"point", target.point},
                {"position", {target.position_W.x(), target.position_W.y(), target.position_W.z()}},
                {"normal", {target.normal_W.x(), target.normal_W.y(), target.normal_W.z()}},
                {"tool", nameOf(target, tools)},
                {"margin_m", target.margin_m < 0 ? Json(nullptr) : Json(shortened(target.margin_m))},
                {"confidence", shortened(target.confidence)},
                {"access_probability",
                 target.access_probability < 0 ? Json(nullptr) : Json(shortened(target.access_probability))},
                {"distance_m", target.distance_m},
                {"covers_points", target.covers},
                {"value", target.value == kNoAttribute ? Json(nullptr) : Json(target.value)},
                {"why", target.why},
                {"approaches", Json::array()}};
    for (const ApproachPath& path : target.approaches) one["approaches"].push_back(jsonOf(path));
    json["targets"].push_back(std::move(one));
  }
  return json.dump(2) + "\n";
}

void writeApproaches(const std::filesystem::path& folder, const Approaches& found,
                     const std::vector<std::string>& tools) {
  writeFileDurably(folder / "approaches.json", [&](std::ostream& stream) { stream << approachesJson(found, tools); });
  writeFileDurably(folder / "approaches.csv", [&](std::ostream& stream) { stream << csvOf(found, tools); });
  writeFileDurably(folder / "approaches.ply", [&](std::ostream& stream) { writeArrows(stream, found); });
}

}  // namespace accessvdb::io
