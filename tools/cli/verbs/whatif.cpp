// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb whatif: what a cut would open, and in which order to cut.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/result_page.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/what_if.h"
#include "options/command_line.h"
#include "options/map_options.h"
#include "options/page_options.h"
#include "options/region_options.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/state_file.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct WhatIfOptions {
  CommonOptions common;
  MapOptions given;  ///< the tool
  std::string state, segments, out;
  std::vector<std::string> remove;
  int cuts = 0;
  bool json = false, html = false, allow_changed = false;
  PageHeader header;
};

Json threeOf(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

/// One line per step, and what they add up to.
struct Answer {
  Json json;
  std::string words;
  io::ResultPage::Table table;
  FieldSnapshot opens;  ///< points that would open
};

std::string counted(std::uint64_t count, const std::string& one, const std::string& many) {
  return std::to_string(count) + " " + (count == 1 ? one : many);
}

FieldSnapshot snapshotLike(const AccessibilityField& field, std::vector<SurfacePoint> points) {
  FieldSnapshot snapshot;
  snapshot.points = std::move(points);
  snapshot.origin_W = field.origin_W();
  snapshot.voxel_size_m = field.params().tsdf.voxel_size_m;
  return snapshot;
}

Json jsonPoints(const std::vector<SurfacePoint>& points) {
  Json list = Json::array();
  for (const SurfacePoint& point : points) {
    const Eigen::Quaternionf& q = point.orientation_WT;
    list.push_back({{"id", point.id},
                    {"position", threeOf(point.position_W)},
                    {"direction", threeOf(point.direction_W.cast<double>())},
                    {"orientation", {q.w(), q.x(), q.y(), q.z()}},
                    {"score", point.score}});
  }
  return list;
}

Answer answerRegions(const AccessibilityField& field, const std::vector<Region>& regions) {
  const WhatIf what_if = field.whatIf(regions);
  Json json = {{"removed", Json::array()},
               {"voxels", what_if.voxels},
               {"colliding_voxels", what_if.colliding_voxels},
               {"points_gone", what_if.points_gone},
               {"opens", what_if.opens.size()},
               {"points_tried", what_if.points_tried},
               {"direction_tests", what_if.direction_tests},
               {"timing_ms", {{"choose", what_if.choose_ms}, {"score", what_if.score_ms}}},
               {"points", jsonPoints(what_if.opens)}};
  std::string words;
  for (const Region& region : regions) {
    json["removed"].push_back(region.inWords());
    words += "without " + region.inWords() + "\n";
  }
  words += counted(what_if.opens.size(), "point opens", "points open") + "; " +
           counted(what_if.points_gone, "point", "points") + " and " +
           counted(what_if.colliding_voxels, "colliding voxel", "colliding voxels") + " would be gone\n";
  io::ResultPage::Table table = {"What would go", {"part"}, {}};
  for (const Region& region : regions) table.rows.push_back({region.inWords()});
  return {json, words, table, snapshotLike(field, what_if.opens)};
}

Answer answerSegments(const AccessibilityField& field, const std::vector<Segment>& segments, int most_cuts) {
  const CutOrder order = orderCuts(field, segments, static_cast<std::size_t>(most_cuts));
  Json json = {{"segments", segments.size()}, {"cuts", Json::array()}};
  std::string words;
  std::vector<Region> cut;
  io::ResultPage::Table table = {"Cuts, in this order", {"", "cut", "where", "points that open"}, {}};
  for (std::size_t n = 0; n < order.cuts.size(); ++n) {
    const Cut& step = order.cuts[n];
    const Segment& segment = segments[step.segment];
    json["cuts"].push_back({{"segment", segment.name},
                            {"region", segment.region.inWords()},
                            {"opens", step.opens.size()},
                            {"points_gone", step.points_gone},
                            {"ids", step.opens}});
    words += std::to_string(n + 1) + ". cut " + segment.name + " (" + segment.region.inWords() +
             "): " + counted(step.opens.size(), "point opens", "points open") + "\n";
    cut.push_back(segment.region);
    table.rows.push_back(
        {std::to_string(n + 1), segment.name, segment.region.inWords(), std::to_string(step.opens.size())});
  }
  if (order.cuts.empty()) words += "no cut of a single segment opens a point\n";
  json["left"] = Json::array();
  for (const std::size_t n : order.left) json["left"].push_back(segments[n].name);
  json["left_together"] = order.left_together;
  if (!order.left.empty()) {
    const bool stopped = most_cuts > 0 && order.cuts.size() == static_cast<std::size_t>(most_cuts);
    words +=
        counted(order.left.size(), "segment is", "segments are") + " left" +
        (stopped ? "" : ", of which none opens a point by itself") +
        (order.left.size() > 1 ? "; all of them together would open " + std::to_string(order.left_together) + " more"
                               : "") +
        "\n";
  }
  std::vector<SurfacePoint> opens;
  if (!cut.empty()) opens = field.whatIf(cut).opens;
  json["opens"] = opens.size();
  words += counted(opens.size(), "point", "points") + " open after all cuts\n";
  return {json, words, table, snapshotLike(field, std::move(opens))};
}

io::ResultPage pageOf(const AccessibilityField& field, const Answer& answer, const PageHeader& header) {
  io::ResultPage page;
  page.kind = "What cuts would open";
  page.title = header.title;
  page.client = header.client;
  page.site = header.site;
  page.sentences = {"Tool: " + field.tool().name() + ". " +
                    counted(answer.opens.points.size(), "surface point", "surface points") +
                    " that it cannot reach now could be reached afterwards."};
  page.marks = {{"would open", "#1a7f37"}};
  page.tables = {answer.table};
  page.voxel_size_m = field.params().tsdf.voxel_size_m;
  page.visit = [&field, &answer](const io::ResultPage::TakeMarked& take) {
    const auto points = field.points();
    for (std::size_t n = 0; n < points->size(); ++n) take(points->position_W(n), std::nullopt);
    for (const SurfacePoint& point : answer.opens.points) take(point.position_W, 0);
  };
  return page;
}

void checkOptions(const WhatIfOptions& options) {
  checkCommonOptions(options.common);
  if (options.html && options.out.empty()) {
    throw InvalidArgument("usage.missing", "--html", "needs a folder to write into", "Add --out");
  }
  if (options.state.empty()) {
    throw InvalidArgument("usage.missing", "whatif", "needs a saved state",
                          "Run map with --checkpoint FOLDER, and name that folder");
  }
  if (options.remove.empty() == options.segments.empty()) {
    throw InvalidArgument("usage.missing", "whatif", "needs either --remove REGION or --segments FILE",
                          "See accessvdb whatif --help");
  }
  if (options.cuts < 0) {
    throw InvalidArgument("usage.cuts", "--cuts", "cannot be negative", "Use 0 for as many as open anything");
  }
}

}  // namespace

int runWhatIf(const Arguments& arguments, Messages& messages) {
  WhatIfOptions options;
  FlagParser flags;
  flags.describe("whatif",
                 "Which points would open if parts of a map went: a branch that could be cut. Works on a state that "
                 "map --checkpoint saved, and changes nothing. With --segments, in which order to cut.",
                 "accessvdb whatif out/state --tool builtin:pruner --remove box:1.2,0,0.5,1.6,0.4,1.1 --out out/cut\n"
                 "  accessvdb whatif out/state --tool builtin:pruner --segments branches.ply --out out/cuts");
  addCommonOptions(flags, options.common);
  flags.option("STATE", &options.state, "folder of map --checkpoint, or a state file");
  addToolsOptions(flags, options.given);
  addDoubtfulToolOptions(flags, options.given);
  flags.list("--remove", options.remove, std::string("what would go; may be repeated: ") + kRegionForms);
  flags.option("--segments", &options.segments,
               "what can be cut: .ply with a property segment of each point (0: none), or text with a line \"name "
               "xmin ymin zmin xmax ymax zmax\" per box");
  flags.option("--cuts", &options.cuts, "with --segments: stop after so many cuts; 0 = when nothing opens");
  flags.option("--out", &options.out, "folder for whatif.ply (the points that open) and whatif.json");
  flags.flag("--html", options.html, "with --out: also write whatif.html, a page to send");
  addPageHeader(flags, options.header, "What cuts would open");
  flags.flag("--json", options.json, "print the answer as JSON");
  addAllowChanged(flags, options.allow_changed);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkOptions(options);
  endOnStopSignals(messages);
  std::vector<Region> regions;
  for (const std::string& text : options.remove) regions.push_back(parseRegion(text));
  const fs::path file =
      stateFile(options.state, "usage.whatif", "nothing can be tried again", {options.allow_changed, messages});
  if (!options.out.empty()) {
    options.given.common = options.common;
    options.given.remove = options.remove;
    Paths outputs = inFolder(options.out, {"whatif.ply", "whatif.json"});
    if (options.html) outputs.push_back(fs::path(options.out) / "whatif.html");
    requireNoInputs(outputs, joined(joined(namedInputs(options.given), {options.segments}), filesOfMap(options.state)));
    requireOwn(outputs);
    io::prepareOutputFolder(options.out);
  }

  const AccessibilityField field = loadField(file, options.given, options.common, messages);
  requireClosedTools(options.given, field.tools());
  requireShownTools(options.given, field.tools(), field.params(), field.toolShareHidden(), messages);
  Answer answer = options.segments.empty()
                      ? answerRegions(field, regions)
                      : answerSegments(field, readSegments(options.segments, field, messages), options.cuts);
  answer.json["tool_sha256"] = field.tool().sha256();
  answer.json["device"] = field.deviceName();
  if (!options.out.empty()) {
    const fs::path out = options.out;
    io::writePointsPly(out / "whatif.ply", answer.opens, {{"tool", field.tool().name()}});
    io::writeFileDurably(out / "whatif.json",
                         [&](std::ostream& stream) { stream << jsonText(answer.json, 2) << "\n"; });
    if (options.html) {
      const std::string page = io::htmlOf(pageOf(field, answer, options.header));
      io::writeFileDurably(out / "whatif.html", [&](std::ostream& stream) { stream << page; });
    }
    messages.notice(std::string("wrote whatif.ply") +
                    (options.html ? ", whatif.json and whatif.html" : " and whatif.json") + " into " + options.out);
  }
  printData(options.json ? jsonText(answer.json, 2) + "\n" : answer.words);
  return 0;
}

}  // namespace accessvdb::tools
