// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Names, checks and descriptions of several tools.
#include <algorithm>
#include <charconv>
#include <filesystem>
#include <set>
#include <sstream>

#include "accessvdb/error.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/tool_tables.h"
#include "io/streams/exact_text.h"
#include "io/streams/input_file.h"
#include "io/streams/sha256.h"
#include "tool/tool_rolls.h"

namespace accessvdb {
namespace {

constexpr std::size_t kLongestName = 32;

bool isNameLetter(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
}

std::string withEnding(const std::string& name, const std::string& ending) {
  return name.substr(0, kLongestName - std::min(ending.size(), kLongestName)) + ending;
}

/// "_20mm", "_2-5mm": points are no letters of a name.
std::string marginEnding(double margin_m) {
  char text[40];
  std::string ending(text, std::to_chars(text, text + sizeof text, 1000 * margin_m, std::chars_format::fixed, 3).ptr);
  ending.erase(ending.find_last_not_of('0') + 1);
  if (ending.back() == '.') ending.pop_back();
  std::replace(ending.begin(), ending.end(), '.', '-');
  return "_" + ending + "mm";
}

std::string nameFrom(const ToolGeometry& tool) {
  const std::string builtin = "builtin:";
  std::string name = tool.name().starts_with(builtin) ? tool.name().substr(builtin.size())
                                                      : std::filesystem::path(tool.name()).stem().string();
  for (char& c : name) c = isNameLetter(c) ? c : '_';
  name.resize(std::min(name.size(), kLongestName));
  if (name.empty()) name = "tool";
  return tool.margin_m() > 0 ? withEnding(name, marginEnding(tool.margin_m())) : name;
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
      spec.name = withEnding(stem, number);
    }
  }
  return tools;
}

std::vector<ToolSpec> withMargins(std::vector<ToolSpec> tools, std::vector<double> margins_m) {
  tools = namedTools(std::move(tools));
  std::sort(margins_m.begin(), margins_m.end());
  margins_m.erase(std::unique(margins_m.begin(), margins_m.end()), margins_m.end());
  for (std::size_t n = 1; n < margins_m.size(); ++n) {  // their tools would have one name
    if (marginEnding(margins_m[n]) != marginEnding(margins_m[n - 1])) continue;
    throw InvalidArgument("tool.margin", internal::exactText(margins_m[n]) + " m",
                          "is hardly another margin than the one before",
                          "Leave one out: they are told apart by thousandths of a millimetre");
  }
  std::vector<ToolSpec> all;
  for (const ToolSpec& spec : tools) {
    all.push_back(spec);
    for (const double margin_m : margins_m) {
      ToolSpec grown = spec;
      grown.tool = spec.tool.grownBy(margin_m);
      if (margin_m == 0) continue;
      grown.name = withEnding(spec.name, marginEnding(margin_m));
      all.push_back(std::move(grown));
    }
  }
  return namedTools(std::move(all));
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
  bool oriented = false, rolled = false, grown = false;
  std::istringstream shared(params.describe());
  for (std::string line; std::getline(shared, line);) {
    if (!isOwn(line)) out += line + "\n";
  }
  for (const ToolSpec& spec : tools) {
    const std::string prefix = std::string("tool_").append(spec.name).append("_");
    out += prefix + "sha256 " + spec.tool.sha256() + "\n";
    if (spec.tool.margin_m() > 0) out += prefix + "margin_m " + internal::exactText(spec.tool.margin_m()) + "\n";
    grown = grown || spec.tool.margin_m() > 0;
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
  // These say which columns a file of points has.
  if (grown) {
    std::string margins_m;
    for (const ToolSpec& spec : tools)
      margins_m.append(margins_m.empty() ? "" : ",").append(internal::exactText(spec.tool.margin_m()));
    out += "margins_m " + margins_m + "\n";
  }
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
