// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb report: a field as one page for a browser.
#include "verbs/html_report.h"

#include <algorithm>
#include <deque>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/program/html_report.h"
#include "accessvdb/program/path_facts.h"
#include "options/command_line.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/output_record.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

struct ToolOfRun {
  ToolOptions options = {};
  double margin_m = 0;  ///< by which it is grown, behind the same tool without one
};

/// What report.json says that the run's tools were, in their order; of a run that does not say it, one without a name.
std::vector<ToolOfRun> toolsOfRun(const fs::path& folder) {
  const nlohmann::json report = nlohmann::json::parse(io::contentAt(folder / "report.json"), nullptr, false);
  const auto toolIn = [](const nlohmann::json& object) {
    const auto text = [&](const char* key) {
      const auto found = object.is_object() ? object.find(key) : object.end();
      return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
    };
    ToolOfRun tool{{text("tool"), text("tool_unit"), text("tool_tip"), text("tool_axis"), text("tool_up")}};
    if (object.is_object() && object.contains("margin_m") && object["margin_m"].is_number())
      tool.margin_m = object["margin_m"];
    return tool;
  };
  std::vector<ToolOfRun> tools;
  if (report.is_object() && report.contains("tools") && report["tools"].is_array()) {
    for (const nlohmann::json& tool : report["tools"]) tools.push_back(toolIn(tool));
  } else if (report.is_object() && report.contains("parameters")) {
    tools.push_back(toolIn(report["parameters"]));
  }
  if (tools.empty()) tools.emplace_back();
  return tools;
}

bool isBuiltin(const std::string& tool) { return tool.starts_with("builtin:"); }

/// The tool to draw: the given one, placed as in the run where the flags do not say how; else the run's, if it needs no
/// file. Without a name there is none.
ToolOptions toolToDraw(ToolOptions given, const ToolOptions& of_run) {
  if (given.tool.empty()) return isBuiltin(of_run.tool) ? of_run : ToolOptions();
  const bool placed = !given.unit.empty() || !given.tip.empty() || !given.axis.empty() || !given.up.empty();
  if (placed || isBuiltin(given.tool) || isBuiltin(of_run.tool)) return given;
  const std::string file = given.tool;
  given = of_run;
  given.tool = file;
  return given;
}

/// One for each tool of the run.
std::vector<ToolOfRun> toolsToDraw(const ToolOptions& given, const fs::path& folder) {
  std::vector<ToolOfRun> drawn = toolsOfRun(folder);
  const auto own = static_cast<std::size_t>(
      std::count_if(drawn.begin(), drawn.end(), [](const ToolOfRun& tool) { return tool.margin_m == 0; }));
  MapOptions all;
  all.tool = given;
  std::vector<MapOptions> each = optionsOfEach(all);
  if (given.tool.empty()) {
    each.resize(std::max<std::size_t>(own, 1), each.front());
  } else if (each.size() != own) {
    throw InvalidArgument(
        "usage.tool", "--tool",
        "is given " + std::to_string(each.size()) + " times, and the map has " + std::to_string(own) +
            (own == 1 ? " tool" : " tools"),
        "Give it once for each tool of the map, in their order; - leaves one out; without it built-in tools are drawn");
  }
  std::size_t given_for = 0;
  for (std::size_t k = 0; k < drawn.size(); ++k) {
    if (k > 0 && drawn[k].margin_m == 0) ++given_for;
    const ToolOptions& of_it = each[std::min(given_for, each.size() - 1)].tool;
    drawn[k].options = of_it.tool == "-" ? ToolOptions() : toolToDraw(of_it, drawn[k].options);
  }
  return drawn;
}

}  // namespace

void writePage(const PageSources& sources, Messages& messages) {
  io::HtmlReportOptions options;
  options.tools = sources.tools;
  options.allow_changed = sources.allow_changed;
  options.approaches = sources.approaches;
  options.views = sources.views;
  options.title = sources.header.title;
  options.client = sources.header.client;
  options.site = sources.header.site;
  if (sources.most_points > 0) options.most_points = sources.most_points;
  const io::HtmlReport page = io::writeHtmlReport(sources.html, sources.folder, options);
  for (const auto& [id, text] : page.warnings) messages.warning(id, text);
  for (const std::string& text : page.notices) messages.notice(text);
  if (page.cell_m > 0) {
    messages.notice("the page draws " + std::to_string(page.drawn) + " of " + std::to_string(page.points) +
                    " points: one for each reason in each cube of " + numberText(page.cell_m) + " m");
  }
  std::error_code ignored;
  messages.notice("wrote " + sources.html.string() + ", " +
                  bytesInWords(static_cast<double>(fs::file_size(sources.html, ignored))));
  recordOutput(sources.folder, sources.html);
}

int runReport(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  ToolOptions tool_options;
  std::string map, out, approaches, views;
  bool allow_changed = false;
  std::uint64_t most_points = io::HtmlReportOptions().most_points;
  FlagParser flags;
  flags.describe(
      "report",
      "Writes a field as one HTML file that opens in any browser, without a network: points by reason, what "
      "to do about it, the tool in place.",
      "accessvdb report --map out/ --out report.html\n"
      "  accessvdb report --map out/ --tool pruner.stl --out report.html\n"
      "  accessvdb report --map out/ --tool pruner.stl --tool builtin:pencil --out report.html\n"
      "  accessvdb report --map out/ --approaches approaches/ --out report.html\n"
      "  accessvdb report --map out/ --views views/ --out report.html\n"
      "  accessvdb report --map out/ --title \"Pruning plan\" --client \"City of X\" --site \"Oak Lane\" --out "
      "report.html");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "output folder of accessvdb map");
  flags.option("--out", &out, "the HTML file to write");
  flags.option("--max-points", &most_points,
               "draw at most so many points; one per cube and reason where there are more");
  flags.option("--approaches", &approaches,
               "approaches.json of accessvdb approaches, or its folder: where to go first, with each way in");
  flags.option("--views", &views, "views.json of accessvdb views, or its folder: where to look next");
  PageSources sources;
  addPageHeader(flags, sources.header, "the folder's name");
  addToolPlaces(flags, tool_options);
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);

  if (map.empty())
    throw InvalidArgument("usage.missing", "--map", "is missing", "Name the output folder of accessvdb map");
  if (out.empty()) throw InvalidArgument("usage.missing", "--out", "is missing", "Name the HTML file to write");
  if (most_points < io::HtmlReportOptions::kLeastPoints) {
    throw InvalidArgument("usage.max_points", "--max-points",
                          "must be " + std::to_string(io::HtmlReportOptions::kLeastPoints) + " or more");
  }
  endOnStopSignals(messages);
  const std::vector<ToolOfRun> drawn = toolsToDraw(tool_options, map);
  auto inputs = joined({common.config}, filesOfMap(map));
  if (!approaches.empty()) inputs = joined(std::move(inputs), {approaches, fs::path(approaches) / "approaches.json"});
  if (!views.empty()) inputs = joined(std::move(inputs), {views, fs::path(views) / "views.json"});
  for (const ToolOfRun& tool : drawn) inputs = joined(std::move(inputs), filesOfTools(tool.options));
  requireNoInputs({out}, inputs);
  std::deque<ToolGeometry> tools;  // whose addresses stay
  for (const ToolOfRun& tool : drawn) {
    io::DrawnTool& next = sources.tools.emplace_back();
    if (tool.options.tool.empty()) continue;
    next.geometry = &tools.emplace_back(loadTool(tool.options).grownBy(tool.margin_m));
    if (!isBuiltin(tool.options.tool)) next.file = tool.options.tool;
    if (tool.margin_m == 0) sayToolNotes(tools.back(), messages);
  }
  if (tools.empty()) {
    sources.tools.clear();
    messages.notice("no tool in the page: name the run's tool with --tool to see it in place");
  } else if (tools.size() < drawn.size()) {
    messages.notice(
        "not all tools are in the page: name each with --tool, in the order of the run, to see it in place");
  }
  sources.html = out;
  sources.folder = map;
  sources.approaches = approaches;
  sources.views = views;
  sources.most_points = most_points;
  sources.allow_changed = allow_changed;
  writePage(sources, messages);
  return 0;
}

}  // namespace accessvdb::tools
