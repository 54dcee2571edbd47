// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb report: a field as one page for a browser.
#include "verbs/html_report.h"

#include <nlohmann/json.hpp>
#include <optional>

#include "accessvdb/error.h"
#include "accessvdb/program/html_report.h"
#include "accessvdb/program/path_facts.h"
#include "options/command_line.h"
#include "output/output_files.h"
#include "output/output_record.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// What report.json says that the run's tool was; empty without a readable one.
ToolOptions toolOfRun(const fs::path& folder) {
  ToolOptions tool;
  const nlohmann::json report = nlohmann::json::parse(io::contentAt(folder / "report.json"), nullptr, false);
  if (!report.is_object() || !report.contains("parameters") || !report["parameters"].is_object()) return tool;
  if (report.contains("tools")) return tool;  // of several, the page draws none
  const auto text = [&](const char* key) {
    const auto found = report["parameters"].find(key);
    return found != report["parameters"].end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  return {text("tool"), text("tool_unit"), text("tool_tip"), text("tool_axis"), text("tool_up")};
}

bool isBuiltin(const std::string& tool) { return tool.starts_with("builtin:"); }

/// The tool to draw: the given one, placed as in the run where the flags do not say how; else the run's, if it needs no
/// file.
std::optional<ToolOptions> toolToDraw(ToolOptions given, const fs::path& folder) {
  const ToolOptions of_run = toolOfRun(folder);
  if (given.tool.empty()) return isBuiltin(of_run.tool) ? std::optional(of_run) : std::nullopt;
  const bool placed = !given.unit.empty() || !given.tip.empty() || !given.axis.empty() || !given.up.empty();
  if (placed || isBuiltin(given.tool) || isBuiltin(of_run.tool)) return given;
  const std::string file = given.tool;
  given = of_run;
  given.tool = file;
  return given;
}

}  // namespace

void writePage(const PageSources& sources, Messages& messages) {
  io::HtmlReportOptions options;
  options.tool = sources.tool;
  options.tool_file = sources.tool_file;
  options.allow_changed = sources.allow_changed;
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
  std::string map, out;
  bool allow_changed = false;
  std::uint64_t most_points = io::HtmlReportOptions().most_points;
  FlagParser flags;
  flags.describe(
      "report",
      "Writes a field as one HTML file that opens in any browser, without a network: points by reason, what "
      "to do about it, the tool in place.",
      "accessvdb report --map out/ --out report.html\n"
      "  accessvdb report --map out/ --tool pruner.stl --out report.html\n"
      "  accessvdb report --map out/ --title \"Pruning plan\" --client \"City of X\" --site \"Oak Lane\" --out "
      "report.html");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "output folder of accessvdb map");
  flags.option("--out", &out, "the HTML file to write");
  flags.option("--max-points", &most_points,
               "draw at most so many points; one per cube and reason where there are more");
  PageSources sources;
  addPageHeader(flags, sources.header, "the folder's name");
  addToolOptions(flags, tool_options);
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
  const auto drawn = toolToDraw(tool_options, map);
  requireNoInputs({out}, joined(joined(filesOfTools(drawn.value_or(ToolOptions())), {common.config}), filesOfMap(map)));
  std::optional<ToolGeometry> tool;
  if (drawn) {
    tool = loadTool(*drawn);
    sayToolNotes(*tool, messages);
  } else {
    messages.notice("no tool in the page: name the run's tool with --tool to see it in place");
  }
  sources.html = out;
  sources.folder = map;
  sources.tool = tool ? &*tool : nullptr;
  if (drawn && !isBuiltin(drawn->tool)) sources.tool_file = drawn->tool;
  sources.most_points = most_points;
  sources.allow_changed = allow_changed;
  writePage(sources, messages);
  return 0;
}

}  // namespace accessvdb::tools
