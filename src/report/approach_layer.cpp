// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/approach_layer.h"

#include <cstdio>
#include <limits>
#include <string_view>

#include "accessvdb/error.h"
#include "report/result_text.h"

namespace accessvdb::internal {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kVerb = "approaches";
/// Both files have positions as doubles, to the last digit.
constexpr double kSamePlace_m = 1e-6;
/// The poses before and after contact are on the way of one tool: beyond this they are none.
constexpr double kLongestWay_m = 1000;

std::string placeInWords(const Eigen::Vector3d& p_W) {
  std::string text;
  for (int axis = 0; axis < 3; ++axis) {
    char number[40];
    std::snprintf(number, sizeof number, "%s%.3f", axis == 0 ? "" : " ", p_W[axis]);
    text += number;
  }
  return text;
}

/// @param most_m  farthest from the point
Json poseNear(const ResultText& text, const Eigen::Vector3d& point_W, double most_m) {
  if (!((text.place() - point_W).norm() <= most_m)) {
    throw ResultText::Wrong{"has a pose that is not at its target: " + text.path()};
  }
  return text.pose();
}

Json approachOf(const ResultText& text, const Eigen::Vector3d& point_W) {
  const ResultText arc = text.at("free_arc_deg");
  return {{"pre_contact", poseNear(text.at("pre_contact"), point_W, kLongestWay_m)},
          {"contact", poseNear(text.at("contact"), point_W, kSamePlace_m)},
          {"retreat", poseNear(text.at("retreat"), point_W, kLongestWay_m)},
          {"collisions", text.at("collisions").count(std::numeric_limits<std::uint16_t>::max())},
          {"free_arc_deg", arc.isNull() ? Json(nullptr) : Json(arc.number(0, 360))},
          {"seen_free_m", text.at("seen_free_m").number(0, kLongestWay_m)}};
}

Json targetOf(const ResultText& text, const Eigen::Vector3d& point_W) {
  constexpr double kAny = std::numeric_limits<double>::max();
  constexpr std::uint64_t kMany = std::numeric_limits<std::uint64_t>::max();
  const ResultText margin = text.at("margin_m"), value = text.at("value");
  Json shown = {{"position", {point_W.x(), point_W.y(), point_W.z()}},
                {"margin_m", margin.isNull() ? Json(nullptr) : Json(margin.number(0, kAny))},
                {"confidence", text.at("confidence").number(0, 1)},
                {"distance_m", text.at("distance_m").number(0, kAny)},
                {"covers_points", text.at("covers_points").count(kMany)},
                {"value", value.isNull() ? Json(nullptr) : Json(value.number(-kAny, kAny))},
                {"why", text.at("why").text()},
                {"approaches", Json::array()}};
  for (const ResultText& approach : text.at("approaches").list())
    shown["approaches"].push_back(approachOf(approach, point_W));
  if (shown["approaches"].empty()) throw ResultText::Wrong{"has a target without a way in: " + text.path()};
  return shown;
}

/// As approaches() calls the tool of a map of one.
std::string nameOfOnlyTool(const FieldFolder& folder) {
  std::string name = folder.metadataOf("tool");
  constexpr std::string_view kBuiltin = "builtin:";
  name = name.starts_with(kBuiltin) ? name.substr(kBuiltin.size()) : std::filesystem::path(name).stem().string();
  const auto isLetter = [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  };
  for (char& c : name) c = isLetter(c) ? c : '_';
  constexpr std::size_t kLongestName = 32;
  return name.substr(0, kLongestName);
}

}  // namespace

ApproachLayer::ApproachLayer(const std::filesystem::path& path) : file_(resultFile(path, kVerb)) {
  readResult(file_, kVerb, [&](const ResultText& text) {
    constexpr std::uint64_t kMany = std::numeric_limits<std::uint64_t>::max();
    for (const char* key : {"accessible_points", "covered_points"}) counts_[key] = text.at(key).count(kMany);
    for (const ResultText& each : text.at("targets").list()) {
      Target target;
      target.point = static_cast<std::uint32_t>(each.at("point").count(std::numeric_limits<std::uint32_t>::max()));
      target.position_W = each.place();
      target.tool = each.at("tool").text();
      target.shown = targetOf(each, target.position_W);
      targets_of_.emplace(target.point, targets_.size());
      targets_.push_back(std::move(target));
    }
  });
}

void ApproachLayer::see(const std::string& tile, const SurfacePoint& point) {
  const auto [begin, end] = targets_of_.equal_range(point.id);
  for (auto at = begin; at != end; ++at) {
    Target& target = targets_[at->second];
    target.last_W = point.position_W;
    if (!((point.position_W - target.position_W).norm() <= kSamePlace_m)) continue;
    target.tile = tile;
    target.tools = point.tools;
    target.accessible = point.label == PointLabel::Accessible;
  }
}

std::optional<std::size_t> ApproachLayer::toolOf(const Target& target, const FieldFolder& folder) const {
  if (folder.tools.empty()) return target.tool == nameOfOnlyTool(folder) ? std::optional<std::size_t>(0) : std::nullopt;
  for (std::size_t k = 0; k < folder.tools.size(); ++k) {
    if (folder.tools[k] == target.tool) return k;
  }
  return std::nullopt;
}

Json ApproachLayer::shown(const FieldFolder& folder) const {
  Json json = counts_;
  json["targets"] = Json::array();
  for (std::size_t n = 0; n < targets_.size(); ++n) {
    const Target& target = targets_[n];
    if (!target.tile) {
      throw UnusableInput("approaches.other_map", file_.string(),
                          "is of another map: target " + std::to_string(n) + " is point " +
                              std::to_string(target.point) + " at " + placeInWords(target.position_W) +
                              (target.last_W ? ", which the map has at " + placeInWords(*target.last_W)
                                             : ", and the map has no such point"),
                          "Run accessvdb approaches on the checkpoint of this map");
    }
    const std::optional<std::size_t> tool = toolOf(target, folder);
    Json one = {{"point", target.point},
                {"tile", *target.tile},
                {"tool", tool ? Json(*tool) : Json(nullptr)},
                {"tool_name", target.tool}};
    one.update(target.shown);
    json["targets"].push_back(std::move(one));
  }
  return json;
}

std::vector<std::pair<std::string, std::string>> ApproachLayer::warnings(const FieldFolder& folder) const {
  std::size_t not_reached = 0;
  std::string unknown;
  for (const Target& target : targets_) {
    const std::optional<std::size_t> tool = toolOf(target, folder);
    if (!tool) unknown = target.tool;
    const bool by_it = !tool || folder.tools.empty() || (target.tools >> *tool & 1) == 1;
    if (!target.accessible || !by_it) ++not_reached;
  }
  std::vector<std::pair<std::string, std::string>> warnings;
  if (!unknown.empty()) {
    warnings.emplace_back("approaches.tool", "approaches are for the tool " + unknown +
                                                 ", which the map has not by this name: it is not drawn in place");
  }
  if (not_reached > 0) {
    warnings.emplace_back("approaches.labels",
                          std::to_string(not_reached) + " of " + std::to_string(targets_.size()) +
                              " targets cannot be reached according to the map: they are of another tool, or the map "
                              "has changed");
  }
  return warnings;
}

}  // namespace accessvdb::internal
