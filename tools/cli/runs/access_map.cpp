// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/access_map.h"
#include "options/tools_given.h"
#include "output/json_text.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "accessvdb/access_map.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "runs/state_file.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json threeOf(const auto& v) { return {v.x(), v.y(), v.z()}; }

Json jsonOfMap(const AccessMap& map) {
  const SurfacePoint& point = map.point;
  Json json = {{"point", point.id},
               {"position", threeOf(point.position_W)},
               {"normal", threeOf(point.normal_W)},
               {"label", name(point.label)},
               {"reason", name(point.reason)},
               {"best_direction", point.direction != kNoDirection ? Json(point.direction) : Json(nullptr)},
               {"collision_limit", map.collision_limit}};
  Json directions = Json::array();
  for (const DirectionOutcome& outcome : map.directions) {
    const Eigen::Quaternionf& q = outcome.orientation_WT;
    directions.push_back({{"direction", threeOf(outcome.direction_W)},
                          {"orientation", {q.w(), q.x(), q.y(), q.z()}},
                          {"outcome", outcome.reason == PointReason::None ? "free" : name(outcome.reason)},
                          {"score", outcome.score != kNoScore ? Json(outcome.score) : Json(nullptr)},
                          {"roll", outcome.score != kNoScore ? Json(outcome.roll) : Json(nullptr)}});
  }
  json["directions"] = directions;
  return json;
}

std::string outcomesInWords(const AccessMap& map) {
  char line[256];
  std::snprintf(line, sizeof line, "point %u at %.10g %.10g %.10g: %s, reason %s\n", map.point.id,
                map.point.position_W.x(), map.point.position_W.y(), map.point.position_W.z(), name(map.point.label),
                name(map.point.reason));
  std::string text = line;
  const auto counts = map.reasons();
  for (int n = 0; n < kNumPointReasons; ++n) {
    if (counts[static_cast<std::size_t>(n)] == 0) continue;
    const auto reason = static_cast<PointReason>(n);
    text += "  " + std::to_string(counts[static_cast<std::size_t>(n)]) + " directions " +
            (reason == PointReason::None ? "free" : name(reason)) + "\n";
  }
  return text;
}

/// The index of a tool by its name; without one, of the tool that stands for the point.
std::size_t toolFor(const std::string& name, const AccessibilityField& field, const Eigen::Vector3d& p_W) {
  if (name.empty()) {
    const auto point = field.pointAt(p_W);
    return point ? point->tool : 0;
  }
  return toolNamed(name, field.tools(), "usage.access_map");
}

}  // namespace

void drawAccessMap(const AccessMapOptions& options, const Eigen::Vector3d& p_W, Messages& messages) {
  const fs::path file =
      stateFile(options.map, "usage.access_map", "no direction can be tried again", {options.allow_changed, messages});
  const AccessibilityField field = loadField(file, options.given, options.common, messages);
  const bool several = field.tools().size() > 1;
  const std::size_t chosen = toolFor(options.for_tool, field, p_W);
  const std::optional<AccessMap> map = field.accessMap(p_W, chosen);
  if (!map) {
    throw InputError("query.no_point", numberText(p_W.x()) + "," + numberText(p_W.y()) + "," + numberText(p_W.z()),
                     "has no surface point in its voxel", "Use the position of a point, as query --at prints it");
  }
  io::renderAccessMap(options.picture, *map);
  messages.notice("wrote " + options.picture);
  Json json = jsonOfMap(*map);
  if (several) json["tool"] = field.tools()[chosen].name;
  const std::string heading = several ? "tool " + field.tools()[chosen].name + ": " : std::string();
  printData(options.json ? jsonText(json, 2) + "\n" : heading + outcomesInWords(*map));
}

}  // namespace accessvdb::tools
