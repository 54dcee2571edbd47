// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb query: what a stored field says at given world positions.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/point_table.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "options/command_line.h"
#include "options/options.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "runs/access_map.h"
#include "runs/checked_results.h"
#include "runs/tool_fits.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;

double yawDegrees(const SurfacePoint& point) {
  const double degrees = point.yaw_rad * 180.0 / std::numbers::pi;
  return degrees < 0 ? degrees + 360.0 : degrees;
}

const char* stateOf(const io::StoredField::Answer& answer) {
  return answer.observed ? "observed" : answer.cleared ? "cleared" : "unknown";
}

template <typename Vector>
Json jsonVector(const Vector& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

using Answers = std::vector<tiles::StoredAnswer>;

/// From a folder of either kind.
Answers answersFrom(const std::string& map, const std::vector<Eigen::Vector3d>& positions_W, io::OutputCheck& check,
                    Messages& messages) {
  const auto warnIfEmpty = [&](bool empty) {
    if (empty) messages.warning("field.empty", map + " holds no surface points");
  };
  if (tiles::hasIndex(map)) {
    const tiles::Index index = tiles::readIndex(map, check);
    if (!index.complete) messages.warning("field.unfinished", "not all tiles of " + map + " are finished");
    warnIfEmpty(std::all_of(index.tiles.begin(), index.tiles.end(), [](const auto& tile) { return tile.points == 0; }));
    return tiles::answersAt(index, positions_W, check);
  }
  const io::StoredField field = io::StoredField::open(map, check);
  warnIfEmpty(field.points().points.empty());
  Answers answers;
  for (const Eigen::Vector3d& p_W : positions_W) answers.push_back({field.at(p_W), std::nullopt});
  return answers;
}

/// Names of several tools, from a folder of either kind; none of one tool.
std::vector<std::string> toolNames(const std::string& map) {
  std::filesystem::path folder = map;
  if (tiles::hasIndex(folder)) {
    const tiles::Index index = tiles::readIndex(folder);
    if (index.tiles.empty()) return {};
    folder = index.tiles.front().folder;
  }
  std::vector<std::string> names;
  for (const auto& [name, text] : io::readPointsHeader(folder / "points.ply").metadata) {
    if (name != "tools") continue;
    std::istringstream each(text);
    for (std::string tool; std::getline(each, tool, ',');) names.push_back(tool);
  }
  return names;
}

/// Of the tools that reach a point.
std::vector<std::string> thoseThatReach(const SurfacePoint& point, const std::vector<std::string>& names) {
  std::vector<std::string> reach;
  for (std::size_t k = 0; k < names.size(); ++k) {
    if ((point.tools >> k & 1) != 0) reach.push_back(names[k]);
  }
  return reach;
}

/// Whether the tool comes level and upright, as with yaw directions.
bool isUpright(const SurfacePoint& point) {
  constexpr float kRounding = 1e-6f;  // of a quaternion in float32
  const Eigen::Quaternionf& q = point.orientation_WT;
  return std::abs(q.x()) < kRounding && std::abs(q.y()) < kRounding;
}

double pitchDegrees(const SurfacePoint& point) {
  return std::asin(std::clamp(static_cast<double>(point.direction_W.z()), -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

Json jsonAnswer(const tiles::StoredAnswer& stored, const std::vector<std::string>& tools) {
  const io::StoredField::Answer& answer = stored.field;
  Json json = {{"at", jsonVector(answer.position_W)}, {"voxel", stateOf(answer)}};
  json["distance_m"] = answer.observed ? Json(answer.distance_m) : Json(nullptr);
  json["weight"] = answer.weight;
  json["point"] = nullptr;
  if (answer.point) {
    const SurfacePoint& point = *answer.point;
    const bool has_direction = point.direction != kNoDirection;
    json["point"] = {
        {"id", point.id},
        {"position", jsonVector(point.position_W)},
        {"offset_m", answer.point_distance_m},
        {"label", name(point.label)},
        {"reason", name(point.reason)},
        {"direction", has_direction ? jsonVector(point.direction_W) : Json(nullptr)},
        {"yaw_deg", has_direction ? Json(yawDegrees(point)) : Json(nullptr)},
        {"score", point.score != kNoScore ? Json(point.score) : Json(nullptr)},
        {"confidence", point.confidence},
        {"stability", point.stability},
        {"access_probability", point.access_probability < 0 ? Json(nullptr) : Json(point.access_probability)},
        {"normal", jsonVector(point.normal_W)}};
    if (has_direction && !isUpright(point)) {
      const Eigen::Quaternionf& q = point.orientation_WT;
      json["point"]["pitch_deg"] = pitchDegrees(point);
      json["point"]["orientation"] = {q.w(), q.x(), q.y(), q.z()};
      json["point"]["roll"] = point.roll;
    }
    if (point.tool < tools.size()) {
      json["point"]["tool"] = tools[point.tool];
      json["point"]["tools"] = thoseThatReach(point, tools);
    }
    if (stored.tile) json["point"]["tile"] = stored.tile->name();
    for (const auto& [name, value] : answer.attributes)
      json["point"]["attributes"][name] = value == kNoAttribute ? Json(nullptr) : Json(value);
  }
  return json;
}

std::string wordsOf(const tiles::StoredAnswer& stored, const std::vector<std::string>& tools) {
  const io::StoredField::Answer& answer = stored.field;
  char line[512];
  std::snprintf(line, sizeof line, "at %.10g %.10g %.10g\n  voxel: %s, distance %s m, weight %.6g\n",
                answer.position_W.x(), answer.position_W.y(), answer.position_W.z(), stateOf(answer),
                answer.observed ? numberText(answer.distance_m).c_str() : "-", answer.weight);
  std::string text = line;
  if (!answer.point) return text + "  no surface point here\n";
  const SurfacePoint& point = *answer.point;
  std::snprintf(line, sizeof line, "  point %u%s, %.4g m away: %s, reason %s, score %s, confidence %.3f\n", point.id,
                stored.tile ? (" of tile " + stored.tile->name()).c_str() : "", answer.point_distance_m,
                name(point.label), name(point.reason),
                point.score != kNoScore ? std::to_string(point.score).c_str() : "-", point.confidence);
  text += line;
  if (point.tool < tools.size()) {
    std::string reach;
    for (const std::string& name : thoseThatReach(point, tools)) reach += " " + name;
    text += "  tool " + tools[point.tool] + "; reached by" + (reach.empty() ? " none" : reach) + "\n";
  }
  for (const auto& [name, value] : answer.attributes)
    text += "  " + name + " " + (value == kNoAttribute ? "-" : std::to_string(value)) + "\n";
  if (point.direction == kNoDirection) return text + "  no best direction\n";
  std::snprintf(line, sizeof line, "  best direction %.4f %.4f %.4f, yaw %.1f degrees\n", point.direction_W.x(),
                point.direction_W.y(), point.direction_W.z(), yawDegrees(point));
  text += line;
  if (isUpright(point)) return text;
  const Eigen::Quaternionf& q = point.orientation_WT;
  const std::string roll = point.roll > 0 ? ", roll " + std::to_string(point.roll) : "";
  std::snprintf(line, sizeof line, "  tool tilted: pitch %.1f degrees%s, orientation %.4f %.4f %.4f %.4f (w x y z)\n",
                pitchDegrees(point), roll.c_str(), q.w(), q.x(), q.y(), q.z());
  return text + line;
}

}  // namespace

int runQuery(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  std::string map, points_file;
  std::vector<std::string> at;
  bool json = false;
  FlagParser flags;
  flags.describe("query", "Prints label, reason, best direction, score, confidence and distance at points.",
                 "accessvdb query --map out/ --at 1.2,-0.4,0.9 --json\n"
                 "  accessvdb query --map out/ --table > table.csv\n"
                 "  accessvdb query --map checkpoint/ --tool pruner.stl --tool-unit mm --fits poses.txt");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "output folder of accessvdb map");
  flags.list("--at", at, "X,Y,Z in the world frame, metres; may be repeated");
  flags.option("--points", &points_file, "text file, one \"x y z\" or \"x,y,z\" per line");
  flags.flag("--json", json, "answer as a JSON array");
  bool table = false;
  flags.flag("--table", table,
             "print points, square metres and reasons of the map, for each value of what --carry brought, as CSV");
  bool allow_changed = false;
  addAllowChanged(flags, allow_changed);
  AccessMapOptions access;
  flags.option("--access-map", &access.picture,
               "PNG of all directions at one point, coloured by what stops each; --map is then the folder of "
               "map --checkpoint, or a state file");
  addToolsOptions(flags, access.given);
  addOrientationOptions(flags, access.given);
  flags.option("--for-tool", &access.for_tool,
               "with --access-map, --fits and several tools, given as for map: name of the tool; default: the first, "
               "with --access-map the first that reaches the point, else the one that comes closest");
  ToolFitOptions fits;
  flags.option("--fits", &fits.poses,
               "text file of poses of the tool, one \"x y z qw qx qy qz\" per line, tip and orientation in the world "
               "frame: what it meets there, as CSV; --map as for --access-map");
  flags.flag("--contact", fits.contact,
             "with --fits: the tip touches a surface point there, as where the map scores it");
  flags.flag("--along", fits.along, "with --fits: the poses are a way, on which the tool moves from each to the next");
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);

  if (map.empty())
    throw InvalidArgument("usage.missing", "--map", "is missing", "Name the output folder of accessvdb map");
  if (table) {
    if (!at.empty() || !points_file.empty() || json || !access.picture.empty() || !fits.poses.empty())
      throw InvalidArgument("usage.table", "--table", "is of the whole map, as CSV", "Give --map and --table alone");
    io::OutputCheck check(allow_changed);
    const std::string text = io::csvOf(io::pointTable(map, check));
    sayFindings(check, messages);
    printData(text);
    return 0;
  }
  if (!fits.poses.empty()) {
    if (!at.empty() || !points_file.empty() || !access.picture.empty())
      throw InvalidArgument("usage.fits", "--fits", "has its own poses", "Leave --at, --points and --access-map out");
    fits.given = access.given;
    fits.given.common = fits.common = common;
    fits.map = map;
    fits.for_tool = access.for_tool;
    fits.json = json;
    fits.allow_changed = allow_changed;
    printToolFits(fits, messages);
    return 0;
  }
  if (fits.contact || fits.along)
    throw InvalidArgument("usage.fits", fits.contact ? "--contact" : "--along", "is only for --fits",
                          "Add --fits FILE");
  if (at.empty() == points_file.empty()) {
    throw InvalidArgument("usage.missing", "query", "needs --at X,Y,Z, --points FILE, --fits FILE or --table",
                          "See accessvdb query --help");
  }
  std::vector<Eigen::Vector3d> positions_W;
  for (const std::string& text : at) positions_W.push_back(parseVector("--at", text));
  if (!points_file.empty()) positions_W = io::readPositions(points_file);

  if (!access.picture.empty()) {
    if (positions_W.size() != 1) {
      throw InvalidArgument("usage.access_map", "--access-map",
                            "draws one point, not " + std::to_string(positions_W.size()), "Give one --at X,Y,Z");
    }
    access.given.common = common;
    requireNoInputs({access.picture}, joined(joined(namedInputs(access.given), {points_file}), filesOfMap(map)));
    access.common = common;
    access.map = map;
    access.json = json;
    access.allow_changed = allow_changed;
    drawAccessMap(access, positions_W.front(), messages);
    return 0;
  }
  Json answers = Json::array();
  std::string text;
  io::OutputCheck check(allow_changed);
  const auto stored = answersFrom(map, positions_W, check, messages);
  sayFindings(check, messages);
  const std::vector<std::string> tools = toolNames(map);
  for (const tiles::StoredAnswer& answer : stored) {
    if (json) {
      answers.push_back(jsonAnswer(answer, tools));
    } else {
      text += wordsOf(answer, tools);
    }
  }
  printData(json ? jsonText(answers, 2) + "\n" : text);
  return 0;
}

}  // namespace accessvdb::tools
