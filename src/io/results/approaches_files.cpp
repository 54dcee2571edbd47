// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// approaches.json, approaches.csv and approaches.ply.
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>

#include "accessvdb/approaches.h"
#include "accessvdb/attributes.h"
#include "accessvdb/field_io.h"
#include "io/results/label_colours.h"
#include "io/results/program_version.h"

namespace accessvdb::io {
namespace {

using Json = nlohmann::ordered_json;

std::array<double, 7> numbersOf(const Eigen::Isometry3d& T_WT) {
  Eigen::Quaterniond q(T_WT.linear());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d& p = T_WT.translation();
  std::array<double, 7> numbers = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  for (double& number : numbers) number += 0.0;  // no -0
  return numbers;
}

/// As few digits as a float32 has.
double shortened(float value) { return std::round(static_cast<double>(value) * 1e6) / 1e6; }

std::string nameOf(const ApproachTarget& target, const std::vector<std::string>& tools) {
  return target.tool < tools.size() ? tools[target.tool] : std::to_string(target.tool);
}

Json jsonOf(const Eigen::Isometry3d& T_WT) {
  const std::array<double, 7> n = numbersOf(T_WT);
  return {{"position", {n[0], n[1], n[2]}}, {"orientation_wxyz", {n[3], n[4], n[5], n[6]}}};
}

Json jsonOf(const ApproachPath& path) {
  return {{"pre_contact", jsonOf(path.pre_contact_T_WT)},
          {"contact", jsonOf(path.contact_T_WT)},
          {"retreat", jsonOf(path.retreat_T_WT)},
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
  text << "\n";
  for (std::size_t n = 0; n < found.targets.size(); ++n) {
    const ApproachTarget& target = found.targets[n];
    for (std::size_t k = 0; k < target.approaches.size(); ++k) {
      const ApproachPath& path = target.approaches[k];
      text << n << "," << k << "," << target.point << "," << nameOf(target, tools) << "," << shortened(target.margin_m)
           << "," << shortened(path.free_arc_deg) << "," << shortened(target.confidence) << "," << path.collisions
           << "," << path.seen_free_m;
      for (const Eigen::Isometry3d& T_WT : {path.pre_contact_T_WT, path.contact_T_WT, path.retreat_T_WT})
        for (const double number : numbersOf(T_WT)) text << "," << number;
      text << "\n";
    }
  }
  return text.str();
}

/// A slender pyramid for each approach, from the pre-contact pose to the point, which is its tip: the first of a target
/// green, the others grey.
void writePly(std::ostream& stream, const Approaches& found) {
  static_assert(std::endian::native == std::endian::little, "records are copied directly from memory");
  std::size_t arrows = 0;
  for (const ApproachTarget& target : found.targets) arrows += target.approaches.size();
  stream << "ply\nformat binary_little_endian 1.0\ncomment AccessVDB " << internal::programVersion()
         << "\nelement vertex " << 5 * arrows
         << "\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\n"
            "property uchar blue\nproperty int target\nelement face "
         << 5 * arrows << "\nproperty list uchar int vertex_indices\nend_header\n";
  const auto put = [&](const auto& value) {
    stream.write(reinterpret_cast<const char*>(&value), static_cast<std::streamsize>(sizeof value));
  };
  std::int32_t number = 0;
  for (const ApproachTarget& target : found.targets) {
    bool first = true;
    for (const ApproachPath& path : target.approaches) {
      const auto colour = internal::colourOf(first ? PointLabel::Accessible : PointLabel::Unscored);
      const Eigen::Matrix3d& R = path.contact_T_WT.linear();
      const Eigen::Vector3d tip = path.contact_T_WT.translation(), base = path.pre_contact_T_WT.translation();
      const double half_m = 0.04 * (base - tip).norm();
      const std::array<Eigen::Vector3d, 5> corners = {
          tip, base + half_m * (R.col(1) + R.col(2)), base + half_m * (R.col(1) - R.col(2)),
          base - half_m * (R.col(1) + R.col(2)), base - half_m * (R.col(1) - R.col(2))};
      for (const Eigen::Vector3d& p : corners) {
        for (int axis = 0; axis < 3; ++axis) put(p[axis]);
        for (const std::uint8_t part : colour) put(part);
        put(number);
      }
      first = false;
    }
    ++number;
  }
  const auto face = [&](std::initializer_list<std::int32_t> corners, std::int32_t begin) {
    put(static_cast<std::uint8_t>(corners.size()));
    for (const std::int32_t corner : corners) put(begin + corner);
  };
  for (std::int32_t begin = 0; begin < static_cast<std::int32_t>(5 * arrows); begin += 5) {
    face({0, 1, 2}, begin);
    face({0, 2, 3}, begin);
    face({0, 3, 4}, begin);
    face({0, 4, 1}, begin);
    face({4, 3, 2, 1}, begin);
  }
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
  writeFileDurably(folder / "approaches.ply", [&](std::ostream& stream) { writePly(stream, found); });
}

}  // namespace accessvdb::io
