// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb info: what is inside a .vdb file, an output folder or a recording.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/program/recording_info.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/tiles.h"
#include "options/command_line.h"
#include "options/options.h"
#include "output/json_text.h"
#include "runs/state_file.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

Json jsonPairs(const std::vector<std::pair<std::string, std::string>>& pairs) {
  Json json = Json::object();
  for (const auto& [key, value] : pairs) json[key] = value;
  return json;
}

/// Every .vdb file written by AccessVDB names its version in the file's metadata.
bool isOurs(const io::VdbSummary& summary) {
  for (const auto& [key, value] : summary.metadata) {
    if (key == "accessvdb_version") return true;
  }
  return false;
}

Json describeVdb(const fs::path& path) {
  const io::VdbSummary summary = io::summarizeVdb(path);
  Json grids = Json::array();
  for (const io::GridSummary& grid : summary.grids) {
    const Eigen::Vector3d& v = grid.voxel_size_m;
    grids.push_back({{"name", grid.name},
                     {"type", grid.type},
                     {"class", grid.grid_class},
                     {"active_voxels", grid.active_voxels},
                     {"leaves", grid.leaves},
                     {"bytes", grid.bytes},
                     {"min_ijk", grid.min_ijk},
                     {"max_ijk", grid.max_ijk},
                     {"voxel_size_m", {v.x(), v.y(), v.z()}},
                     {"metadata", jsonPairs(grid.metadata)}});
  }
  return {{"path", path.string()},
          {"creator", summary.creator},
          {"accessvdb", isOurs(summary)},
          {"metadata", jsonPairs(summary.metadata)},
          {"grids", grids}};
}

/// The counts of an output folder, from its report.
Json describeReport(const fs::path& path) {
  const Json report = Json::parse(io::contentAt(path), nullptr, false);
  if (report.is_discarded() || !report.is_object()) {
    throw InputError("input.report", path.string(), "is not valid JSON", "Run accessvdb map again");
  }
  return report;
}

std::string text(const Json& value) {
  return printable(value.is_string() ? value.get<std::string>() : jsonText(value, -1));
}

std::string wordsOfVdb(const Json& vdb) {
  std::string words = text(vdb["path"]) + "\n";
  if (!vdb["creator"].get<std::string>().empty()) words += "  creator: " + text(vdb["creator"]) + "\n";
  for (const auto& [key, value] : vdb["metadata"].items()) {
    if (key != "creator") words += "  " + printable(key) + ": " + text(value) + "\n";
  }
  if (!vdb["accessvdb"].get<bool>()) words += "  not written by AccessVDB\n";
  if (vdb["grids"].empty()) words += "  no grids\n";
  for (const Json& grid : vdb["grids"]) {
    words += "  grid " + text(grid["name"]) + ": " + text(grid["type"]) + ", class " + text(grid["class"]) + ", " +
             text(grid["active_voxels"]) + " active voxels, " + text(grid["leaves"]) + " leaves, " +
             bytesInWords(grid["bytes"].get<double>()) + ", voxel " +
             numberText(grid["voxel_size_m"][0].get<double>()) + " m";
    if (grid["active_voxels"].get<std::uint64_t>() > 0)
      words += ", voxels " + text(grid["min_ijk"]) + " to " + text(grid["max_ijk"]);
    words += "\n";
    for (const auto& [key, value] : grid["metadata"].items()) {
      // Metadata that every grid shares with the file is printed once.
      if (key != "name" && key != "class" && !vdb["metadata"].contains(key))
        words += "    " + printable(key) + ": " + text(value) + "\n";
    }
  }
  return words;
}

std::string wordsOfReport(const Json& report) {
  std::string words = "report.json\n";
  for (const char* key : {"version", "exit_code", "device"}) {
    if (report.contains(key)) words += std::string("  ") + key + ": " + text(report[key]) + "\n";
  }
  if (report.contains("counts") && report["counts"].is_object()) {
    for (const auto& [key, value] : report["counts"].items())
      words += "  " + printable(key) + ": " + text(value) + "\n";
  }
  return words;
}

/// A map in tiles: its list, and which files it is in.
Json describeTiles(const tiles::Index& index) {
  Json list = Json::array();
  for (const tiles::IndexedTile& tile : index.tiles) {
    list.push_back({{"tile", tile.id.name()},
                    {"folder", tile.folder.string()},
                    {"points", tile.points},
                    {"min_W", tile.min_W},
                    {"max_W", tile.max_W}});
  }
  return {{"complete", index.complete},
          {"origin_W", index.origin_W},
          {"voxel_size_m", index.voxel_size_m},
          {"tile_voxels", index.tile_voxels},
          {"tiles", list}};
}

std::string wordsOfTiles(const Json& map) {
  std::string words = "field.json\n  " + text(Json(map["tiles"].size())) + " tiles of " + text(map["tile_voxels"]) +
                      " voxels of " + text(map["voxel_size_m"]) + " m" +
                      (map["complete"].get<bool>() ? "" : ", not all of them are finished") + "\n";
  for (const Json& tile : map["tiles"]) {
    words += "  " + text(tile["folder"]) + ": " + text(tile["points"]) + " points";
    if (tile["points"] != 0) words += ", from " + text(tile["min_W"]) + " to " + text(tile["max_W"]) + " m";
    words += "\n";
  }
  return words;
}

/// A field without a single point is a valid file, but hardly what the user wants.
void warnIfEmpty(const Json& vdb, Messages& messages) {
  if (!vdb["accessvdb"].get<bool>()) return;
  for (const Json& grid : vdb["grids"]) {
    if ((grid["name"] == "density" || grid["name"] == "points") && grid["active_voxels"] == 0) {
      messages.warning("field.empty", vdb["path"].get<std::string>() + " holds no surface points");
    }
  }
}

Json describeRecording(const io::RecordingSummary& recording) {
  Json topics = Json::array();
  for (const io::RecordingTopic& topic : recording.topics) {
    topics.push_back({{"name", topic.name},
                      {"type", topic.type},
                      {"encoding", topic.encoding},
                      {"messages", topic.messages},
                      {"first_s", topic.first_s},
                      {"last_s", topic.last_s},
                      {"frames", topic.frames},
                      {"child_frame", topic.child_frame},
                      {"cloud", topic.cloud},
                      {"pose", topic.pose},
                      {"problem", topic.problem}});
  }
  return {{"files", recording.files},           {"bytes", recording.bytes},      {"messages", recording.messages},
          {"first_s", recording.first_s},       {"last_s", recording.last_s},    {"topics", topics},
          {"transforms", recording.transforms}, {"warnings", recording.warnings}};
}

std::string timeText(double seconds) {
  char text[64];
  std::snprintf(text, sizeof text, "%.3f", seconds);
  return text;
}

std::string wordsOfRecording(const io::RecordingSummary& recording) {
  std::string words;
  for (const std::string& file : recording.files) words += printable(file) + "\n";
  words += "  " + bytesInWords(static_cast<double>(recording.bytes)) + ", " + std::to_string(recording.messages) +
           " messages in " + timeText(recording.last_s - recording.first_s) + " s, from " +
           timeText(recording.first_s) + " to " + timeText(recording.last_s) + "\n";
  if (recording.topics.empty()) words += "  no topics\n";
  for (const io::RecordingTopic& topic : recording.topics) {
    words += "  " + printable(topic.name) + ": " + printable(topic.type) + " (" + printable(topic.encoding) + "), " +
             std::to_string(topic.messages) + " messages";
    if (topic.messages > 1)
      words += " from " + timeText(topic.first_s - recording.first_s) + " to " +
               timeText(topic.last_s - recording.first_s) + " s";
    words += topic.cloud ? ", clouds" : topic.pose ? ", poses" : "";
    for (std::size_t i = 0; i < topic.frames.size(); ++i)
      words +=
          (i == 0 ? " in frame " : ", ") + (topic.frames[i].empty() ? "without a name" : printable(topic.frames[i]));
    if (!topic.child_frame.empty()) words += " of frame " + printable(topic.child_frame);
    if (!topic.problem.empty()) words += "; " + printable(topic.problem);
    words += "\n";
  }
  if (!recording.transforms.empty()) words += "  transforms:\n";
  for (const std::string& edge : recording.transforms) words += "    " + printable(edge) + "\n";
  return words;
}

/// What a later verb has to be told again, above all.
Json describeState(const fs::path& file) {
  const SavedState state = inspectState(file);
  Json tools = Json::array();
  for (const SavedState::Tool& tool : state.tools)
    tools.push_back({{"name", tool.name},
                     {"sha256", tool.sha256},
                     {"orientations", tool.orientations},
                     {"rolls", tool.rolls},
                     {"max_collisions", tool.max_collisions}});
  const FieldParams& params = state.params;
  return {{"path", file.string()},
          {"version", state.version},
          {"scans", state.scans},
          {"points", state.points},
          {"leaves", state.leaves},
          {"voxel_size_m", params.tsdf.voxel_size_m},
          {"clear_rays_m", std::isfinite(params.tsdf.clear_rays_m) ? Json(params.tsdf.clear_rays_m) : Json("all")},
          {"platform_radius_m", params.tsdf.platform_radius_m},
          {"orientations", params.approach.orientations.text()},
          {"tool_sha256", state.tool_sha256},
          {"tools", tools}};
}

std::string wordsOfState(const Json& state) {
  std::string words = text(state["path"]) + "\n  saved state of version " + text(state["version"]) + ": " +
                      text(state["scans"]) + " scans, " + text(state["points"]) + " surface points, voxel " +
                      numberText(state["voxel_size_m"].get<double>()) + " m\n  free space: ";
  const bool cleared = state["clear_rays_m"] != 0.0, platform = state["platform_radius_m"] != 0.0;
  if (cleared) words += "--clear-rays " + text(state["clear_rays_m"]);
  if (platform) words += std::string(cleared ? " " : "") + "--platform-radius " + text(state["platform_radius_m"]);
  words += cleared || platform ? "\n" : "only a band before surfaces\n";
  if (state["tools"].empty()) {
    words +=
        "  one tool, SHA-256 " + text(state["tool_sha256"]) + ", orientations " + text(state["orientations"]) + "\n";
  }
  for (const Json& tool : state["tools"])
    words += "  tool " + text(tool["name"]) + ": SHA-256 " + text(tool["sha256"]) + ", orientations " +
             text(tool["orientations"]) + "\n";
  return words;
}

}  // namespace

int runInfo(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  std::string path;
  bool json = false;
  FlagParser flags;
  flags.describe(
      "info",
      "Shows what is inside a .vdb file, an output folder of accessvdb map, a folder of map --checkpoint, or "
      "a recording.",
      "accessvdb info out/ --json\n  accessvdb info checkpoint/\n  accessvdb info flight.mcap");
  addCommonOptions(flags, common);
  flags.option("path", &path, "FILE.vdb, DIR, a state (.avst), or a recording (.mcap, .db3, .bag)");
  flags.flag("--json", json, "as JSON");
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);

  if (path.empty())
    throw InvalidArgument("usage.missing", "info", "needs FILE.vdb, DIR or a recording", "See accessvdb info --help");
  Json result;
  std::error_code status;
  if (io::isRecordingFile(path)) {
    const io::RecordingSummary recording = io::summarizeRecording(path);
    for (const std::string& warning : recording.warnings) messages.warning("recording.cut_off", warning);
    result = describeRecording(recording);
    printData(json ? jsonText(result, 2) + "\n" : wordsOfRecording(recording));
    return 0;
  }
  std::optional<fs::path> state;
  if (!io::isFolder(path) && fs::path(path).extension() == ".avst") state = path;
  // A folder may hold both; then its results are meant.
  const bool results = io::isFolder(path) && (io::isThere(fs::path(path) / "report.json") || tiles::hasIndex(path) ||
                                              io::isThere(fs::path(path) / "field.vdb"));
  if (io::isFolder(path) && !results && io::isThere(fs::path(path) / "state.json"))
    state = stateFile(path, "input.no_state", "there is nothing to show", {true, messages});
  if (state) {
    result = describeState(*state);
    printData(json ? jsonText(result, 2) + "\n" : wordsOfState(result));
    return 0;
  }
  if (!io::isFolder(path)) {
    result = describeVdb(path);
    warnIfEmpty(result, messages);
    printData(json ? jsonText(result, 2) + "\n" : wordsOfVdb(result));
    return 0;
  }
  const fs::path folder = path;
  result = {{"path", path}, {"report", nullptr}, {"files", Json::array()}};
  std::string words;
  if (io::isThere(folder / "report.json")) {
    result["report"] = describeReport(folder / "report.json");
    words += wordsOfReport(result["report"]);
  }
  if (tiles::hasIndex(folder)) {
    result["tiles"] = describeTiles(tiles::readIndex(folder));
    words += wordsOfTiles(result["tiles"]);
  }
  for (const char* file : {"field.vdb", "field_points.vdb"}) {
    if (!io::isThere(folder / file)) continue;
    result["files"].push_back(describeVdb(folder / file));
    warnIfEmpty(result["files"].back(), messages);
    words += wordsOfVdb(result["files"].back());
  }
  if (words.empty()) {
    throw InputError("input.no_field", path, "the folder contains neither field.vdb nor report.json, nor a state",
                     "Name the --out or --checkpoint folder of accessvdb map, or a .vdb file; of scans, accessvdb "
                     "advise tells more");
  }
  printData(json ? jsonText(result, 2) + "\n" : words);
  return 0;
}

}  // namespace accessvdb::tools
