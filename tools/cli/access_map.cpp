// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "access_map.h"
#include "tools_given.h"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "accessvdb/access_map.h"
#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// The state in the folder of a checkpoint, or the file itself.
fs::path stateFile(const std::string& map) {
  std::error_code ignored;
  if (!fs::is_directory(map, ignored)) return map;
  const fs::path manifest = fs::path(map) / "state.json";
  std::ifstream in(manifest);
  const Json json = Json::parse(in, nullptr, false);
  if (!in || !json.is_object() || !json.contains("generation") || !json["generation"].is_number_unsigned()) {
    throw InvalidArgument("usage.access_map", map,
                          "holds results, but no saved state, without which no direction can be tried again",
                          "Run map with --checkpoint FOLDER, and name that folder");
  }
  return fs::path(map) / ("state-" + std::to_string(json["generation"].get<std::uint64_t>()) + ".avst");
}

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
  for (std::size_t k = 0; k < field.tools().size(); ++k) {
    if (field.tools()[k].name == name) return k;
  }
  throw InvalidArgument("usage.access_map", "--for-tool", "\"" + name + "\" is not one of the tools",
                        "Use one of " + namesOf(field.tools()));
}

}  // namespace

void drawAccessMap(const AccessMapOptions& options, const Eigen::Vector3d& p_W, Messages& messages) {
  if (options.given.tool.tool.empty()) {
    throw InvalidArgument("usage.missing", "--tool", "is missing, with --access-map",
                          "Name the tool that the state was made with, in the same unit and pose");
  }
  const fs::path file = stateFile(options.map);
  const SavedState saved = inspectState(file);
  MapOptions given = options.given;
  given.voxel_m = saved.params.tsdf.voxel_size_m;
  if (saved.tools.empty()) requireOneTool(given, "a state of one tool");
  std::vector<ToolSpec> tools = loadTools(given);
  sayToolsNotes(given, tools, messages);
  // A state of one tool says itself how it is turned.
  if (saved.tools.empty()) tools = onlyTool(tools.front().tool, saved.params);
  const BackendKind backend = options.common.device == "cpu"    ? BackendKind::Cpu
                              : options.common.device == "cuda" ? BackendKind::Cuda
                                                                : BackendKind::Auto;
  AccessibilityField field = AccessibilityField::loadState(file, tools, backend, options.common.threads);
  while (!saved.updated && field.update().backlog > 0) {
  }
  const std::size_t chosen = toolFor(options.for_tool, field, p_W);
  const std::optional<AccessMap> map = field.accessMap(p_W, chosen);
  if (!map) {
    throw InputError("query.no_point", numberText(p_W.x()) + "," + numberText(p_W.y()) + "," + numberText(p_W.z()),
                     "has no surface point in its voxel", "Use the position of a point, as query --at prints it");
  }
  io::renderAccessMap(options.picture, *map);
  Json json = jsonOfMap(*map);
  if (tools.size() > 1) json["tool"] = field.tools()[chosen].name;
  const std::string heading = tools.size() > 1 ? "tool " + field.tools()[chosen].name + ": " : std::string();
  printData(options.json ? json.dump(2) + "\n" : heading + outcomesInWords(*map));
}

}  // namespace accessvdb::tools
