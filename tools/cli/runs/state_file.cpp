// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/state_file.h"

#include <cstdint>
#include <nlohmann/json.hpp>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/saved_state.h"
#include "options/tools_given.h"
#include "output/progress.h"

namespace accessvdb::tools {

namespace fs = std::filesystem;

fs::path stateFile(const std::string& map, const std::string& id, const std::string& why, const ChangedState& changed) {
  if (!io::isFolder(map)) return map;
  const fs::path manifest = fs::path(map) / "state.json";
  const auto json = nlohmann::ordered_json::parse(io::contentAt(manifest), nullptr, false);
  if (!json.is_object() || !json.contains("generation") || !json["generation"].is_number_unsigned() ||
      json["generation"] == 0) {
    throw InvalidArgument(id, map, "holds results, but no saved state, without which " + why,
                          "Run map with --checkpoint FOLDER, and name that folder");
  }
  fs::path file = fs::path(map) / ("state-" + std::to_string(json["generation"].get<std::uint64_t>()) + ".avst");
  // A state has hashes of all its parts, but may be another one.
  if (json.contains("head_sha256") && json["head_sha256"] != inspectState(file).sha256) {
    const std::string problem = "is not the state of which " + manifest.string() + " has the hash";
    if (!changed.allowed) {
      throw InputError("output.changed", file.string(), problem,
                       "Copy the folder again or run map --checkpoint again; --allow-changed reads it all the same");
    }
    changed.messages.warning("output.changed", file.string() + " " + problem + "; read all the same");
  }
  return file;
}

namespace {

/// A state says itself how its tools are turned, and what they may touch: flags may repeat that, and nothing else. Of
/// several tools, most is in the hash of their list.
void requireAsSaved(const MapOptions& given, const std::vector<ToolSpec>& tools, const SavedState& saved) {
  const auto refuse = [](const char* flag, const std::string& problem) {
    throw InvalidArgument("usage.state", flag, problem, "Leave it out, or map again with it and --checkpoint");
  };
  const ApproachParams& approach = saved.params.approach;
  const ToolSpec& tool = tools.front();
  if (given.directions && *given.directions != approach.num_directions)
    refuse("--directions", "differs from the state's, which has " + std::to_string(approach.num_directions));
  if (!saved.tools.empty()) return;
  if (tools.size() > 1) refuse("--margins", "is given for a state that was made without margins");
  if (!given.orientations.empty() && tool.orientations.text() != approach.orientations.text())
    refuse("--orientations", "differs from the state's, which are " + approach.orientations.text());
  if (!given.rolls.empty() && tool.rolls != approach.rolls)
    refuse("--rolls", "differs from the state's, which has " + std::to_string(approach.rolls));
  if (!given.max_collisions.empty() && tool.max_collisions != saved.params.scoring.max_collisions)
    refuse("--max-collisions", "differs from the state's");
}

}  // namespace

AccessibilityField loadField(const fs::path& state, const MapOptions& tool_options, const CommonOptions& common,
                             Messages& messages) {
  if (tool_options.tool.tool.empty()) {
    throw InvalidArgument("usage.missing", "--tool", "is missing",
                          "Name the tool that the state was made with, in the same unit and pose");
  }
  const SavedState saved = inspectState(state);
  MapOptions given = tool_options;
  given.voxel_m = saved.params.tsdf.voxel_size_m;
  if (saved.tools.empty()) requireOneTool(given, "a state of one tool");
  std::vector<ToolSpec> tools = loadTools(given);
  sayToolsNotes(given, tools, messages);
  // A state of one tool says itself how it is turned.
  requireAsSaved(given, tools, saved);
  if (saved.tools.empty()) tools = onlyTool(tools.front().tool, saved.params);
  const BackendKind backend = common.device == "cpu"    ? BackendKind::Cpu
                              : common.device == "cuda" ? BackendKind::Cuda
                                                        : BackendKind::Auto;
  AccessibilityField field =
      AccessibilityField::loadState(state, tools, backend, common.threads, tableProgress(messages));
  while (!saved.updated && field.update().backlog > 0) {
  }
  return field;
}

}  // namespace accessvdb::tools
