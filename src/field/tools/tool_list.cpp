// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Names, checks and descriptions of several tools.
#include <algorithm>
#include <filesystem>
#include <set>
#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tool_tables.h"
#include "io/streams/input_file.h"
#include "io/streams/sha256.h"
#include "tool/tool_rolls.h"

namespace accessvdb {
namespace {

constexpr std::size_t kLongestName = 32;

bool isNameLetter(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

std::string nameFrom(const ToolGeometry& tool) {
  const std::string builtin = "builtin:";
  std::string name = tool.name().starts_with(builtin) ? tool.name().substr(builtin.size())
                                                      : std::filesystem::path(tool.name()).stem().string();
  for (char& c : name) c = isNameLetter(c) ? c : '_';
  name.resize(std::min(name.size(), kLongestName));
  return name.empty() ? "tool" : name;
}

void requireNames(const std::vector<ToolSpec>& tools) {
  std::set<std::string> taken;
  for (const ToolSpec& spec : tools) {
    if (spec.name.empty()) continue;
    const std::string shown = io::wordForMessage(spec.name);
    if (spec.name.size() > kLongestName || !std::all_of(spec.name.begin(), spec.name.end(), isNameLetter)) {
      throw InvalidArgument("tool.name", shown, "is not a name for a tool",
                            "Use 1 to 32 letters, digits, _ and - without spaces");
    }
    if (!taken.insert(spec.name).second) {
      throw InvalidArgument("tool.name", shown, "is the name of two tools", "Give each tool its own name");
    }
  }
}

}  // namespace

std::vector<ToolSpec> namedTools(std::vector<ToolSpec> tools) {
  if (tools.empty() || tools.size() > kMostTools) {
    throw InvalidArgument("tool.count", std::to_string(tools.size()) + " tools",
                          "a field has 1 to " + std::to_string(kMostTools) + " tools",
                          tools.empty() ? "Name a tool" : "Map the rest in another run");
  }
  requireNames(tools);
  std::set<std::string> taken;
  for (const ToolSpec& spec : tools) taken.insert(spec.name);
  for (ToolSpec& spec : tools) {
    if (!spec.name.empty()) continue;
    const std::string stem = nameFrom(spec.tool);
    spec.name = stem;
    for (int n = 2; !taken.insert(spec.name).second; ++n) {
      std::string number = "_";
      number += std::to_string(n);
      spec.name = stem.substr(0, kLongestName - number.size()) + number;
    }
  }
  return tools;
}

std::vector<ToolSpec> onlyTool(const ToolGeometry& tool, const FieldParams& params) {
  return namedTools({{tool, params.approach.orientations, params.approach.rolls, {}, params.scoring.max_collisions}});
}

FieldParams toolParams(const ToolSpec& tool, FieldParams params) {
  params.approach.orientations = tool.orientations;
  params.approach.rolls = tool.rolls;
  params.scoring.max_collisions = tool.max_collisions;
  return params;
}

std::string describeTools(const std::vector<ToolSpec>& tools, const FieldParams& params) {
  if (tools.size() == 1) return params.describe();
  const auto isOwn = [](const std::string& line) {
    return line.starts_with("orientations ") || line.starts_with("rolls ") || line.starts_with("max_collisions ");
  };
  std::string out, names;
  for (const ToolSpec& spec : tools) names.append(names.empty() ? "" : ",").append(spec.name);
  bool oriented = false, rolled = false;
  std::istringstream shared(params.describe());
  for (std::string line; std::getline(shared, line);) {
    if (!isOwn(line)) out += line + "\n";
  }
  for (const ToolSpec& spec : tools) {
    const std::string prefix = std::string("tool_").append(spec.name).append("_");
    out += prefix + "sha256 " + spec.tool.sha256() + "\n";
    FieldParams of_tool = toolParams(spec, params);
    of_tool.approach.rolls = internal::toolRolls(spec.tool, of_tool.approach).count;
    std::istringstream own(of_tool.describe());
    for (std::string line; std::getline(own, line);) {
      if (!isOwn(line)) continue;
      out += prefix + line + "\n";
      oriented = oriented || line.starts_with("orientations ");
      rolled = rolled || line.starts_with("rolls ");
    }
  }
  // These three say which columns a file of points has.
  out += "tools " + names + "\n";
  if (oriented) out += "orientations by_tool\n";
  if (rolled) out += "rolls by_tool\n";
  return out;
}

std::string toolListSha256(const std::vector<ToolSpec>& tools) {
  if (tools.size() == 1) return tools.front().tool.sha256();
  std::ostringstream text;
  for (const ToolSpec& spec : tools) {
    text << spec.name << " " << spec.tool.sha256() << " " << spec.orientations.text() << " " << spec.rolls << " "
         << spec.max_collisions << "\n";
  }
  const std::string all = text.str();
  internal::Sha256 sha256;
  sha256.update(all.data(), all.size());
  return "tools:" + internal::hexOf(sha256.digest());
}

}  // namespace accessvdb
