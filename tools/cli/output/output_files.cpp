// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/output_files.h"

#include <sys/stat.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/output_file.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/program/point_table.h"
#include "options/tools_given.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

using FileId = std::pair<std::uint64_t, std::uint64_t>;  // device and inode

std::optional<FileId> idOf(const fs::path& path, ErrorCode of) {
  struct stat info;
  if (path.empty()) return std::nullopt;
  while (::stat(path.c_str(), &info) != 0) {
    if (!io::isThere(path, of)) return std::nullopt;
  }
  return FileId{info.st_dev, info.st_ino};
}

std::string lowerCase(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

/// As in "list:FILE" or "mesh:FILE"; empty without one of these words.
fs::path fileBehind(const std::string& text, std::initializer_list<std::string_view> words) {
  for (const std::string_view word : words) {
    if (text.starts_with(word)) return text.substr(word.size());
  }
  return {};
}

void addAllIn(const fs::path& folder, Paths& paths) {
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    std::error_code status;
    if (!entry->is_directory(status)) paths.push_back(entry->path());
  }
}

/// Where the file is or would be, without links in its folders; empty if that cannot be said.
fs::path placeOf(const fs::path& file) {
  std::error_code error;
  const fs::path place = fs::weakly_canonical(fs::absolute(file, error), error);
  return error || file.empty() ? fs::path() : place;
}

/// The first of the files that lies in the folder, or below it; null: none.
const fs::path* firstWithin(const fs::path& folder, const Paths& files) {
  const fs::path whole = placeOf(folder);
  const auto lies = [&](const fs::path& file) {
    const fs::path place = placeOf(file);
    return !place.empty() && std::mismatch(whole.begin(), whole.end(), place.begin(), place.end()).first == whole.end();
  };
  const auto found = whole.empty() ? files.end() : std::ranges::find_if(files, lies);
  return found == files.end() ? nullptr : &*found;
}

/// @throws InvalidArgument "output.is_input" for an input in one of the folders
void requireOutside(const Paths& folders, const Paths& inputs) {
  for (const fs::path& folder : folders) {
    const fs::path* input = firstWithin(folder, inputs);
    if (input == nullptr) continue;
    throw InvalidArgument("output.is_input", folder.string(),
                          "is filled and cleared by this run, but " + input->string() + " is read from it",
                          "Choose another output folder, or move the input; nothing was changed");
  }
}

}  // namespace

void requireDistinct(const Paths& outputs) {
  std::map<fs::path, const fs::path*> by_place;
  std::map<FileId, const fs::path*> by_id;
  for (const fs::path& output : outputs) {
    if (output.empty() || io::isStream(output)) continue;
    const fs::path place = placeOf(output);
    if (place.empty()) continue;  // what is wrong with it is said where it is written
    const fs::path* other = by_place.emplace(place, &output).first->second;
    if (const auto id = idOf(output, ErrorCode::Output); id && other == &output)
      other = by_id.emplace(*id, &output).first->second;
    if (other == &output) continue;
    throw InvalidArgument("output.twice", output.string(),
                          "is to hold two outputs of this run" +
                              (*other == output ? std::string() : "; the other one is named " + other->string()),
                          "Choose another name for one of them; nothing was changed");
  }
}

void requireNotInTiles(const fs::path& out, const Paths& outputs) {
  for (const fs::path& folder : inFolder(out, {"rays", "tiles"})) {
    const fs::path* output = firstWithin(folder, outputs);
    if (output == nullptr) continue;
    throw InvalidArgument("output.is_input", output->string(),
                          "would be written into " + folder.string() + ", which this run reads",
                          "Choose another folder; nothing was changed");
  }
}

void requireNoInputs(const Paths& outputs, const Paths& inputs) {
  requireDistinct(outputs);
  std::map<FileId, const fs::path*> written;
  for (const fs::path& output : outputs) {
    if (output.empty() || io::isStream(output)) continue;
    if (const auto id = idOf(output, ErrorCode::Output)) written.emplace(*id, &output);
  }
  if (written.empty()) return;
  // Inputs first: a folder or a pipe that is read is worse than one that cannot be written.
  for (const fs::path& input : inputs) {
    const auto id = idOf(input, ErrorCode::Input);
    const auto found = id ? written.find(*id) : written.end();
    if (found == written.end()) continue;
    const std::string output = found->second->string();
    throw InvalidArgument("output.is_input", output,
                          "would be overwritten, but this run reads it" +
                              (output == input.string() ? std::string() : " as " + input.string()),
                          "Choose another output; nothing was changed");
  }
  for (const auto& [id, output] : written) io::requireOutputFile(*output);
}

void requireNoInputsInTiles(const fs::path& out, const Paths& inputs) {
  requireOutside(inFolder(out, {"rays", "tiles"}), inputs);
  // The files of one piece would be deleted.
  requireNoInputs(inFolder(out, {"plan.json", "rays.json", "field.json", "preview.png", "report.json", "field.vdb",
                                 "field_points.vdb", "points.ply", "points.las"}),
                  inputs);
}

/// The keys that a JSON file of each kind has at its top.
bool isOwnJson(const fs::path& file) {
  const nlohmann::json json = nlohmann::json::parse(io::contentAt(file), nullptr, false);
  const std::vector<std::vector<const char*>> kinds = {
      {"schema", "version", "parameters", "inputs", "counts"},    // a run
      {"schema", "plan", "tile_voxels", "sha256"},                // the index of tiles
      {"schema", "program", "flights", "sha256"},                 // a plan
      {"plan", "shards", "sha256"},                               // its rays
      {"match", "points_before", "points_after", "transitions"},  // diff
      {"tool_sha256", "removed"},
      {"tool_sha256", "cuts"},                                         // whatif
      {"accessible_points", "tried_without_way", "targets"},           // approaches
      {"unresolved_points", "poses_compared", "views"},                // views
      {"schema", "version", "scene", "trajectory", "frames_written"},  // simulate
      {"schema", "origin", "finished", "rows"},                        // evaluate
      {"schema", "version", "command", "maps", "comparisons"}};        // consistency
  return json.is_object() && std::ranges::any_of(kinds, [&json](const auto& keys) {
           return std::ranges::all_of(keys, [&json](const char* key) { return json.contains(key); });
         });
}

/// By what our writers put where: a file that only speaks of accessvdb is not ours.
bool isOwn(const fs::path& output) {
  std::error_code error;
  if (!io::isFile(output, ErrorCode::Output)) return false;
  const std::string kind = lowerCase(output.extension().string());
  if (kind == ".json") return isOwnJson(output);
  const std::string text = io::beginningAt(output, std::uint64_t{1} << 16);
  const auto begins = [&text](std::string_view with, std::size_t at = 0) {
    return text.size() >= at + with.size() && std::string_view(text).substr(at, with.size()) == with;
  };
  const auto has = [&text](std::string_view words) { return std::string_view(text).find(words) != std::string::npos; };
  if (kind == ".ply") return begins("ply\n") && text.find("\ncomment AccessVDB ") < 64;
  if (kind == ".las") return begins("LASF") && begins("AccessVDB", 26);
  if (kind == ".vdb") return begins(" BDV") && has("accessvdb_version");
  if (kind == ".html") return begins("<!DOCTYPE html>\n<!-- Copyright Contributors to the AccessVDB project");
  if (kind == ".png") {
    if (begins("\x89PNG") && has(std::string_view("Software\0AccessVDB", 18))) return true;
    // Pictures of earlier versions have no mark; a run writes its report after its picture.
    const fs::path report = output.parent_path() / "report.json";
    if (!isOwnJson(report)) return false;
    const auto written = fs::last_write_time(output, error);
    if (error) return false;
    const auto reported = fs::last_write_time(report, error);
    return !error && written <= reported;
  }
  if (kind == ".tif") return (begins("II*") || begins("II+")) && has("AccessVDB ");
  if (kind == ".mcap") return begins("\x89MCAP0\r\n") && begins("AccessVDB ", 25);
  if (kind == ".bt") return begins("# Octomap OcTree binary file\n# AccessVDB ");
  if (kind == ".gpkg") return begins("SQLite format 3") && has("accessible points, written by AccessVDB");
  if (kind == ".csv")
    return begins(io::kTableBegin) || begins("target,approach,point,") || begins("view,resolves,of_confidence,");
  if (kind == ".md")
    return has("- command: accessvdb-lab evaluate") || has("- command: accessvdb evaluate") ||
           begins("# Consistency of labels from recorded scans");
  return false;
}

void requireOwn(const Paths& outputs) {
  for (const fs::path& output : outputs) {
    if (!io::isThere(output, ErrorCode::Output) || io::isStream(output) || isOwn(output)) continue;
    io::requireOutputFile(output);
    throw OutputError("output.foreign", output.string(), "would be overwritten, but accessvdb did not write it",
                      "Choose another output folder, or move this file away; nothing was changed");
  }
}

Paths joined(Paths paths, const Paths& more) {
  paths.insert(paths.end(), more.begin(), more.end());
  return paths;
}

Paths inFolder(const fs::path& folder, const std::vector<std::string>& names) {
  Paths paths;
  for (const std::string& name : names) paths.push_back(folder / name);
  return paths;
}

Paths filesOfMap(const fs::path& map) {
  std::error_code error;
  if (!io::isFolder(map)) return {map, map.parent_path() / "state.json"};
  Paths paths = inFolder(map, {"field.vdb", "field_points.vdb", "points.ply", "points.las", "report.json", "field.json",
                               "plan.json", "rays.json", "state.json"});
  for (const auto& entry : fs::directory_iterator(map, error)) {
    if (entry.path().extension() == ".avst") paths.push_back(entry.path());
  }
  addAllIn(map / "tiles", paths);
  addAllIn(map / "rays", paths);
  return paths;
}

/// What a mesh refers to: materials of an .obj, buffers and pictures of a .gltf.
std::vector<std::string> filesNamedIn(const fs::path& mesh) {
  std::vector<std::string> names;
  const std::string kind = lowerCase(mesh.extension().string());
  if ((kind != ".obj" && kind != ".gltf") || !io::isFile(mesh)) return names;
  if (kind == ".obj") {
    std::istringstream in(io::contentAt(mesh, UINT64_MAX));
    for (std::string line; std::getline(in, line);) {
      if (!line.starts_with("mtllib ")) continue;
      while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
      names.push_back(line.substr(std::string_view("mtllib ").size()));
    }
    return names;
  }
  const nlohmann::json json = nlohmann::json::parse(io::contentAt(mesh, UINT64_MAX), nullptr, false);
  for (const char* list : {"buffers", "images"}) {
    if (!json.is_object() || !json.contains(list) || !json[list].is_array()) continue;
    for (const auto& part : json[list]) {
      if (part.is_object() && part.contains("uri") && part["uri"].is_string()) names.push_back(part["uri"]);
    }
  }
  std::erase_if(names, [](const std::string& name) { return name.starts_with("data:"); });
  return names;
}

Paths filesOfTools(const ToolOptions& tool) {
  Paths paths;
  for (const std::string& mesh : valuesOf(tool.tool)) {
    paths.emplace_back(mesh);
    for (const std::string& name : filesNamedIn(mesh)) paths.push_back(fs::path(mesh).parent_path() / name);
  }
  return paths;
}

Paths namedInputs(const MapOptions& options) {
  Paths paths = filesOfTools(options.tool);
  for (const std::string& file : {options.scans, options.poses, options.calib, options.survey.trajectory,
                                  options.survey.stations, options.common.config, options.replay_log}) {
    if (!file.empty()) paths.emplace_back(file);
  }
  for (const std::string& text : valuesOf(options.orientations)) paths.push_back(fileBehind(text, {"list:"}));
  for (const std::string& text : options.remove) paths.push_back(fileBehind(text, {"mesh:", "ids:"}));
  if (!options.origin.empty()) paths = joined(std::move(paths), filesOfMap(options.origin));
  return paths;
}

Paths inputsWith(const MapOptions& options, const io::ScanSequence& scans) {
  Paths paths = namedInputs(options);
  for (const std::string& path : scans.paths()) paths.emplace_back(path);
  const fs::path given = options.scans;
  for (const fs::path& folder : {given, given.parent_path()}) paths.push_back(folder / "range_noise.txt");
  return paths;
}

}  // namespace accessvdb::tools
