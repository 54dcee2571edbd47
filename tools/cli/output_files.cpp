// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output_files.h"

#include <sys/stat.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/output_file.h"
#include "tools_given.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

using FileId = std::pair<std::uint64_t, std::uint64_t>;  // device and inode

std::optional<FileId> idOf(const fs::path& path) {
  struct stat info;
  if (path.empty() || ::stat(path.c_str(), &info) != 0) return std::nullopt;
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

/// @throws InvalidArgument "output.is_input" for an input in one of the folders
void requireOutside(const Paths& folders, const Paths& inputs) {
  for (const fs::path& folder : folders) {
    std::error_code error;
    const fs::path whole = fs::canonical(folder, error);
    if (error) continue;
    for (const fs::path& input : inputs) {
      const fs::path path = input.empty() ? fs::path() : fs::canonical(input, error);
      if (error || path.empty()) continue;
      if (std::mismatch(whole.begin(), whole.end(), path.begin(), path.end()).first != whole.end()) continue;
      throw InvalidArgument("output.is_input", folder.string(),
                            "is filled and cleared by this run, but " + input.string() + " is read from it",
                            "Choose another output folder, or move the input; nothing was changed");
    }
  }
}

}  // namespace

void requireNoInputs(const Paths& outputs, const Paths& inputs) {
  std::map<FileId, const fs::path*> written;
  for (const fs::path& output : outputs) {
    if (output.empty() || io::isStream(output)) continue;
    if (const auto id = idOf(output)) written.emplace(*id, &output);
  }
  if (written.empty()) return;
  // Inputs first: a folder or a pipe that is read is worse than one that cannot be written.
  for (const fs::path& input : inputs) {
    const auto id = idOf(input);
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

bool isOwn(const fs::path& output) {
  std::error_code error;
  if (!fs::is_regular_file(output, error)) return false;
  if (output.extension() == ".png") {
    return std::ranges::any_of(inFolder(output.parent_path(), {"report.json", "points.ply", "field.json"}), isOwn);
  }
  constexpr std::size_t kPart = std::size_t{1} << 16;
  std::ifstream in(output, std::ios::binary);
  const auto part = [&] {
    std::string text(kPart, '\0');
    in.read(text.data(), static_cast<std::streamsize>(text.size()));
    text.resize(static_cast<std::size_t>(in.gcount()));
    return text;
  };
  const std::string beginning = part();
  if (output.extension() != ".json") return lowerCase(beginning).find("accessvdb") != std::string::npos;
  const std::uintmax_t bytes = fs::file_size(output, error);
  in.clear();
  in.seekg(static_cast<std::streamoff>(bytes - std::min<std::uintmax_t>(bytes, kPart)));
  const std::string text = beginning + part();
  const auto has = [&](const char* key) {
    return text.find(std::string("\"").append(key) + "\"") != std::string::npos;
  };
  // Of a run, with the version; of tiles, with a hash at the end; of diff; of whatif.
  return (has("schema") && (has("version") || has("sha256"))) || has("points_before") || has("tool_sha256");
}

void requireOwn(const Paths& outputs) {
  for (const fs::path& output : outputs) {
    std::error_code error;
    if (!fs::exists(output, error) || io::isStream(output) || isOwn(output)) continue;
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
  if (!fs::is_directory(map, error)) return {map, map.parent_path() / "state.json"};
  Paths paths = inFolder(map, {"field.vdb", "field_points.vdb", "points.ply", "points.las", "report.json", "field.json",
                               "plan.json", "rays.json", "state.json"});
  for (const auto& entry : fs::directory_iterator(map, error)) {
    if (entry.path().extension() == ".avst") paths.push_back(entry.path());
  }
  addAllIn(map / "tiles", paths);
  addAllIn(map / "rays", paths);
  return paths;
}

Paths filesOfTools(const ToolOptions& tool) {
  Paths paths;
  for (const std::string& mesh : valuesOf(tool.tool)) paths.emplace_back(mesh);
  return paths;
}

Paths namedInputs(const MapOptions& options) {
  Paths paths = filesOfTools(options.tool);
  for (const std::string& file : {options.scans, options.poses, options.calib, options.survey.trajectory,
                                  options.survey.stations, options.common.config}) {
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
