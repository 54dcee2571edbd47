// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/tools_given.h"

#include <charconv>
#include <cmath>
#include <iterator>
#include <sstream>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/tool_tables.h"
#include "runs/plausibility.h"

namespace accessvdb::tools {
namespace {

constexpr int kMostCollisions = 65000;
/// What labels need of the tool: less of it tells little about what the rest would touch.
constexpr double kMostHidden = 0.5;
/// In place of a value: the tool has none of its own.
constexpr const char* kNone = "-";

bool isBuiltin(const std::string& tool) { return tool.starts_with("builtin:"); }

/// The value of one tool. @param given  of the flag  @param count  of tools
std::string valueOf(const char* flag, const std::vector<std::string>& given, std::size_t k, std::size_t count) {
  if (given.empty()) return {};
  if (given.size() != 1 && given.size() != count) {
    throw InvalidArgument("usage.tool", flag,
                          "is given " + std::to_string(given.size()) + " times, for " + std::to_string(count) +
                              (count == 1 ? " tool" : " tools"),
                          "Give it once for all tools, or once for each, in their order; - leaves one out");
  }
  const std::string& value = given.size() == 1 ? given.front() : given[k];
  return value == kNone ? std::string() : value;
}

}  // namespace

namespace {

void addTool(FlagParser& flags, ToolOptions& options) {
  flags.repeated("--tool", &options.tool,
                 "tool mesh, or builtin:pencil or builtin:pruner; for several tools once for each, and the flags that "
                 "belong to a tool once for all or once for each, in their order; - leaves one out");
}

void addToolFrame(FlagParser& flags, ToolOptions& options) {
  flags.repeated("--tool-unit", &options.unit, "unit of the mesh: m, cm, mm or in (required for STL, OBJ, PLY)");
  flags.repeated("--tool-tip", &options.tip, "X,Y,Z of the tool's tip, in the mesh's own units and frame");
  flags.repeated("--tool-axis", &options.axis,
                 "direction from the tip along the body, in the mesh's frame: X,Y,Z or x, -x, y ...");
  flags.repeated("--tool-up", &options.up, "direction that becomes up, in the mesh's frame: X,Y,Z or x, -x, y ...");
}

}  // namespace

void addToolPlaces(FlagParser& flags, ToolOptions& options) {
  addTool(flags, options);
  addToolFrame(flags, options);
}

void addToolsOptions(FlagParser& flags, MapOptions& options) {
  addTool(flags, options.tool);
  flags.repeated("--tool-name", &options.tool_name,
                 "name of a tool in the results, of letters, digits, _ and -; default: from its file");
  addToolFrame(flags, options.tool);
  flags.option(
      "--margins", &options.margins,
      "M,M,..: how much room there is around each tool, metres; points get the largest of these with which the "
      "tool still reaches them");
  flags.repeated(
      "--max-collisions", &options.max_collisions,
      "most voxels that may collide in a free direction: auto (the rule, the default), a number, or a volume "
      "in litres, for example 0.5l");
}

void addDoubtfulToolOptions(FlagParser& flags, MapOptions& options) {
  flags.flag("--allow-open-tool", options.allow_open_tool,
             "go on with a mesh that has openings wider than a quarter of its size: only its surface counts");
  flags.flag("--allow-hidden-tool", options.allow_hidden_tool,
             "go on with a tool of which more than half is so near its tip that collisions there do not count");
}

void requireClosedTools(const MapOptions& options, const std::vector<ToolSpec>& tools) {
  if (options.allow_open_tool) return;
  for (const ToolSpec& tool : tools) {
    if (!isWideOpen(tool.tool)) continue;
    const double width_m = openingWidth_m(tool.tool);
    throw UnusableInput("tool.open", tool.tool.name(),
                        "the mesh has an opening " +
                            (std::isfinite(width_m) ? numberText(width_m) + " m wide" : "with no other side") +
                            ", more than a quarter of its size, so what is inside is not known",
                        "Close the mesh, or give --allow-open-tool to count only its surface");
  }
}

double voxelThatShows_m(const ToolGeometry& tool, FieldParams params, double most_m) {
  for (auto voxel_m = std::rbegin(kVoxels_m); voxel_m != std::rend(kVoxels_m); ++voxel_m) {
    if (*voxel_m > most_m) continue;
    params.tsdf.voxel_size_m = *voxel_m;
    params.tsdf.truncation_distance_m = 0;  // by rule: these were for another voxel
    params.scoring.collision_distance_m = 0;
    params.approach.corridor_length_m = 0;
    if (toolShareHidden(tool, params) <= kMostHidden) return *voxel_m;
  }
  return 0;
}

double largestShareHidden(const std::vector<ToolSpec>& tools, const FieldParams& params) {
  double share = 0;
  for (const ToolSpec& tool : tools) share = std::max(share, toolShareHidden(tool.tool, toolParams(tool, params)));
  return share;
}

void requireShownTools(const MapOptions& options, const std::vector<ToolSpec>& tools, const FieldParams& params,
                       double share, Messages& messages) {
  if (share <= kMostHidden || options.allow_hidden_tool) {
    for (const ToolSpec& tool : tools) {
      const double of_tool = tools.size() > 1 ? toolShareHidden(tool.tool, toolParams(tool, params)) : share;
      const auto warning = hiddenToolWarning(of_tool);
      if (!warning) continue;
      messages.warning(warning->id, tools.size() == 1 ? warning->text : "tool " + tool.name + ": " + warning->text);
    }
    return;
  }
  const double voxel_m = params.tsdf.voxel_size_m;
  for (const ToolSpec& tool : tools) {
    const FieldParams own = toolParams(tool, params);
    const double of_tool = tools.size() > 1 ? toolShareHidden(tool.tool, own) : share;
    if (of_tool <= kMostHidden) continue;
    const double shows_m = voxelThatShows_m(tool.tool, own, voxel_m);
    throw UnusableInput("tool.hidden", tool.tool.name(),
                        "at a voxel of " + numberText(voxel_m) + " m, " + numberText(std::round(100 * of_tool)) +
                            " % of the tool is so near its tip that collisions there are not counted (" +
                            numberText(params.scoring.self_exclusion_voxels) + " voxels)",
                        (shows_m > 0 ? "Use --voxel " + numberText(shows_m) + " or smaller, or a larger tool"
                                     : std::string("Use a larger tool, or check --tool-unit")) +
                            "; --allow-hidden-tool goes on all the same");
  }
}

std::vector<std::string> valuesOf(const std::string& repeated) {
  std::vector<std::string> values;
  if (repeated.empty()) return values;
  for (std::size_t begin = 0; begin <= repeated.size();) {
    const std::size_t end = std::min(repeated.find(kBetweenValues, begin), repeated.size());
    values.push_back(repeated.substr(begin, end - begin));
    begin = end + 1;
  }
  return values;
}

std::string valuesInWords(const std::string& repeated) {
  std::string words;
  for (const std::string& value : valuesOf(repeated)) words.append(words.empty() ? "" : ", ").append(value);
  return words;
}

std::vector<MapOptions> optionsOfEach(const MapOptions& options) {
  std::vector<std::string> tools = valuesOf(options.tool.tool);
  if (tools.empty()) tools.emplace_back();
  const std::size_t count = tools.size();
  std::vector<MapOptions> each(count, options);
  if (!options.tool_name.empty() && valuesOf(options.tool_name).size() != count) {
    throw InvalidArgument("usage.tool", "--tool-name",
                          "is given " + std::to_string(valuesOf(options.tool_name).size()) + " times, for " +
                              std::to_string(count) + (count == 1 ? " tool" : " tools"),
                          "Give each tool its own name, in their order");
  }
  using Member = std::string& (*)(MapOptions&);
  struct PerTool {
    const char* flag;
    Member member;
    bool of_mesh;  ///< built-in tools have their own
  };
  const PerTool flags[] = {{"--tool-unit", [](MapOptions& o) -> std::string& { return o.tool.unit; }, true},
                           {"--tool-tip", [](MapOptions& o) -> std::string& { return o.tool.tip; }, true},
                           {"--tool-axis", [](MapOptions& o) -> std::string& { return o.tool.axis; }, true},
                           {"--tool-up", [](MapOptions& o) -> std::string& { return o.tool.up; }, true},
                           {"--tool-name", [](MapOptions& o) -> std::string& { return o.tool_name; }, false},
                           {"--orientations", [](MapOptions& o) -> std::string& { return o.orientations; }, false},
                           {"--rolls", [](MapOptions& o) -> std::string& { return o.rolls; }, false},
                           {"--max-collisions", [](MapOptions& o) -> std::string& { return o.max_collisions; }, false}};
  for (std::size_t k = 0; k < count; ++k) {
    each[k].tool.tool = tools[k];
    for (const PerTool& flag : flags) {
      const std::vector<std::string> given = valuesOf(flag.member(each[k]));
      std::string value = valueOf(flag.flag, given, k, count);
      // Given once for all, it is meant for those that need it.
      if (flag.of_mesh && count > 1 && given.size() == 1 && isBuiltin(tools[k])) value.clear();
      flag.member(each[k]) = std::move(value);
    }
  }
  return each;
}

std::vector<MapOptions> optionsOfEach(const MapOptions& options, const std::vector<ToolSpec>& tools) {
  const std::vector<MapOptions> given = optionsOfEach(options);
  std::vector<MapOptions> each;
  std::size_t own = 0;
  for (const ToolSpec& tool : tools) {
    if (!each.empty() && tool.tool.margin_m() == 0) ++own;
    each.push_back(given[own]);
  }
  return each;
}

std::vector<double> parseMargins(const std::string& text) {
  std::vector<double> margins_m;
  std::istringstream list(text);
  for (std::string word; std::getline(list, word, ',');) {
    double margin_m = 0;
    const char* const end = word.data() + word.size();
    const auto [rest, status] = std::from_chars(word.data(), end, margin_m);
    if (status != std::errc() || rest != end || !(margin_m >= 0 && std::isfinite(margin_m))) {
      throw InvalidArgument("usage.margins", "--margins", "\"" + word + "\" is not a margin",
                            "Write metres with commas between, for example 0,0.02,0.05");
    }
    margins_m.push_back(margin_m);
  }
  return margins_m;
}

void requireOneTool(const MapOptions& options, const std::string& verb) {
  const std::size_t count = valuesOf(options.tool.tool).size();
  if (count <= 1) return;
  throw InvalidArgument("usage.tool", "--tool",
                        "is given " + std::to_string(count) + " times, and " + verb + " takes one tool",
                        "Use map for several tools");
}

std::vector<ToolSpec> loadTools(const MapOptions& options) {
  std::vector<ToolSpec> tools;
  for (const MapOptions& own : optionsOfEach(options)) {
    if (tools.size() == kMostTools) {
      throw InvalidArgument("tool.count", std::to_string(valuesOf(options.tool.tool).size()) + " tools",
                            "a field has 1 to " + std::to_string(kMostTools) + " tools", "Map the rest in another run");
    }
    tools.push_back({loadTool(own.tool),
                     own.orientations.empty() ? OrientationSet::yaw() : OrientationSet::parse(own.orientations),
                     parseRolls(own.rolls), own.tool_name, parseMaxCollisions(own.max_collisions, own.voxel_m)});
  }
  return withMargins(std::move(tools), parseMargins(options.margins));
}

namespace {

/// Tables of a very fine mesh in many orientations take long, and that can be helped; progress alone does not say how.
void sayWhatTablesTake(const ToolSpec& tool, const Messages& messages) {
  constexpr std::size_t kMany = 1'000'000'000;  // triangles turned: about a minute of one core
  const ApproachParams approach = toolParams(tool, {}).approach;
  const auto orientations =
      static_cast<std::size_t>(approach.directionCount()) * static_cast<std::size_t>(rollsOf(tool.tool, approach));
  const std::size_t triangles = tool.tool.triangles().size();
  if (orientations * triangles < kMany) return;
  messages.progress("tool: making tables for " + std::to_string(orientations) + " orientations of " +
                    std::to_string(triangles) + " triangles, which can take minutes; a coarser mesh takes less");
}

}  // namespace

void sayToolsNotes(const MapOptions& options, const std::vector<ToolSpec>& tools, Messages& messages) {
  const std::vector<MapOptions> each = optionsOfEach(options, tools);
  for (std::size_t k = 0; k < tools.size(); ++k) {
    if (k > 0 && tools[k].tool.margin_m() > 0) continue;  // those of the tool itself were said
    sayToolNotes(tools[k].tool, messages);
    sayOrientationNotes(each[k], messages);
    sayWhatTablesTake(tools[k], messages);
  }
}

std::size_t toolNamed(const std::string& name, const std::vector<ToolSpec>& tools, const std::string& id) {
  for (std::size_t k = 0; k < tools.size(); ++k) {
    if (tools[k].name == name) return k;
  }
  throw InvalidArgument(id, "--for-tool", "\"" + name + "\" is not one of the tools", "Use one of " + namesOf(tools));
}

std::string namesOf(const std::vector<ToolSpec>& tools) {
  std::string names;
  for (const ToolSpec& tool : tools) names.append(names.empty() ? "" : ", ").append(tool.name);
  return names;
}

std::vector<std::string> toolsInWords(const MapOptions& options, const std::vector<ToolSpec>& tools) {
  std::vector<std::string> lines;
  const std::vector<MapOptions> each = optionsOfEach(options, tools);
  for (std::size_t k = 0; k < tools.size(); ++k) {
    std::string line = toolInWords(tools[k].tool, each[k].tool);
    if (tools[k].tool.margin_m() > 0) line += ", with " + numberText(tools[k].tool.margin_m()) + " m around it";
    lines.push_back(tools.size() == 1 ? line : std::to_string(k) + " " + tools[k].name + ": " + line);
  }
  return lines;
}

std::vector<ReportedTool> reportedTools(const MapOptions& options, const std::vector<ToolSpec>& tools) {
  std::vector<ReportedTool> reported;
  if (tools.size() == 1) return reported;
  const std::vector<MapOptions> each = optionsOfEach(options, tools);
  for (std::size_t k = 0; k < tools.size(); ++k) {
    const ToolOptions& given = each[k].tool;
    ReportedTool tool;
    tool.name = tools[k].name;
    tool.tool = given.tool;
    tool.unit = given.unit;
    tool.tip = given.tip;
    tool.axis = given.axis;
    tool.up = given.up;
    tool.sha256 = tools[k].tool.sha256();
    tool.orientations = tools[k].orientations.text();
    tool.rolls = rollsOf(tools[k].tool, toolParams(tools[k], {}).approach);
    tool.max_collisions = tools[k].max_collisions;
    tool.margin_m = tools[k].tool.margin_m();
    reported.push_back(std::move(tool));
  }
  return reported;
}

int parseMaxCollisions(const std::string& text, double voxel_size_m) {
  if (text.empty() || text == "auto") return 0;
  double value = -1;
  const char* const end = text.data() + text.size();
  const auto [rest, status] = std::from_chars(text.data(), end, value);
  const std::string unit(rest, end);
  const bool litres = unit == "l";
  const bool known = status == std::errc() && value >= 0 && (litres || (unit.empty() && value == std::floor(value)));
  // A volume that is meant to be whole voxels stays so, whatever the last bit of the quotient says.
  constexpr double kLitre_m3 = 1e-3, kRounding = 1 + 1e-9;
  if (litres) value = std::floor(value * kLitre_m3 / std::pow(voxel_size_m, 3) * kRounding);
  if (!known || !(value <= kMostCollisions)) {
    throw InvalidArgument("usage.max_collisions", "--max-collisions",
                          "\"" + text + "\" is not auto, or 0 .. " + std::to_string(kMostCollisions) + " voxels",
                          "Write a whole number of voxels, or litres with an l behind, for example 0.5l");
  }
  return value == 0 ? -1 : static_cast<int>(value);
}

int parseRolls(const std::string& text) {
  if (text.empty()) return 0;
  int value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, status] = std::from_chars(text.data(), end, value);
  if (status != std::errc() || rest != end) {
    throw InvalidArgument("usage.rolls", "--rolls", "\"" + text + "\" is not a number of rolls",
                          "Write 1 .. 64, or leave it out for the rule");
  }
  return value;
}

}  // namespace accessvdb::tools
