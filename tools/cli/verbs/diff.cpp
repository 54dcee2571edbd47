// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb diff: what changed between two maps of the same place.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/points_diff.h"
#include "accessvdb/program/result_page.h"
#include "options/command_line.h"
#include "options/options.h"
#include "options/page_options.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/point_files.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr const char* kWhyWhole = "what is missing would count as gone";

Json jsonDiff(const io::PointsDiff& diff) {
  Json json = {{"match", diff.match == io::PointMatch::SameVoxel ? "same voxel" : "nearest within one voxel"},
               {"voxel_size_m", diff.voxel_size_m},
               {"points_before", diff.points_before},
               {"points_after", diff.points_after},
               {"same", diff.same}};
  for (int n = 0; n < io::kNumPointChanges; ++n) {
    json[name(static_cast<io::PointChange>(n))] = diff.changes[static_cast<std::size_t>(n)];
  }
  for (const auto& tool : diff.tools)
    json["tools"].push_back({{"name", tool.name}, {"opened", tool.opened}, {"closed", tool.closed}});
  json["transitions"] = Json::array();
  for (const auto& transition : diff.transitions) {
    json["transitions"].push_back({{"label_before", name(transition.label_before)},
                                   {"reason_before", name(transition.reason_before)},
                                   {"label", name(transition.label_after)},
                                   {"reason", name(transition.reason_after)},
                                   {"points", transition.points}});
  }
  json["other_parameters"] = diff.other_parameters;
  return json;
}

/// "blocked (tool)"; an accessible point has no reason.
std::string stateInWords(PointLabel label, PointReason reason) {
  return std::string(name(label)) + (label == PointLabel::Accessible ? "" : std::string(" (") + name(reason) + ")");
}

std::string line(const std::string& what, std::uint64_t points) {
  const std::string count = std::to_string(points);
  return "  " + what + std::string(what.size() < 46 ? 46 - what.size() : 1, ' ') +
         std::string(count.size() < 10 ? 10 - count.size() : 0, ' ') + count + "\n";
}

std::string wordsOf(const io::PointsDiff& diff) {
  const bool same_voxels = diff.match == io::PointMatch::SameVoxel;
  std::string words = std::to_string(diff.points_before) + " points before, " + std::to_string(diff.points_after) +
                      " after; compared " +
                      (same_voxels ? "voxel by voxel" : "with the nearest within one voxel: the maps' origins differ") +
                      "\n";
  words += line("same label", diff.same);
  for (int n = 0; n < io::kNumPointChanges; ++n) {
    words += line(name(static_cast<io::PointChange>(n)), diff.changes[static_cast<std::size_t>(n)]);
  }
  if (!diff.tools.empty()) words += "by tool\n";
  for (const auto& tool : diff.tools) {
    words += line("opened for " + tool.name, tool.opened);
    words += line("closed for " + tool.name, tool.closed);
  }
  if (!diff.transitions.empty()) words += "by label and reason, before -> after\n";
  for (const auto& transition : diff.transitions) {
    words += line(stateInWords(transition.label_before, transition.reason_before) + " -> " +
                      stateInWords(transition.label_after, transition.reason_after),
                  transition.points);
  }
  return words;
}

/// A box of positions that differ, of one map.
std::string boxOf(const io::PointsDiff& diff, io::PointChange change) {
  Eigen::AlignedBox3d box_W;
  for (const io::ChangedPoint& changed : diff.points) {
    if (changed.change == change) box_W.extend(changed.point.position_W);
  }
  const auto corner = [](const Eigen::Vector3d& p_W) {
    char text[96];
    std::snprintf(text, sizeof text, "%.1f, %.1f, %.1f", p_W.x(), p_W.y(), p_W.z());
    return std::string(text);
  };
  return "(" + corner(box_W.min()) + ") to (" + corner(box_W.max()) + ") m";
}

/// Two places, or one place in two frames: all that either map has is "appeared" or "gone" then.
void warnIfApart(const io::PointsDiff& diff, Messages& messages) {
  constexpr double kLeastShare = 0.01;  // of the smaller map
  std::uint64_t paired = diff.same;
  for (const auto& transition : diff.transitions) paired += transition.points;
  const std::uint64_t smaller = std::min(diff.points_before, diff.points_after);
  if (smaller == 0 || static_cast<double>(paired) >= kLeastShare * static_cast<double>(smaller)) return;
  messages.warning("diff.no_overlap",
                   "the maps do not overlap: " + std::to_string(paired) + " of " + std::to_string(smaller) +
                       " points have a counterpart. The earlier map's lie in " + boxOf(diff, io::PointChange::Gone) +
                       ", the later map's in " + boxOf(diff, io::PointChange::Appeared) +
                       ": are they of one place, with poses in one world frame?");
}

/// One page for people who did not make the maps.
io::ResultPage pageOf(const io::PointsDiff& diff, const std::vector<fs::path>& after, const PageHeader& header) {
  io::ResultPage page;
  page.kind = "What changed";
  page.title = header.title;
  page.client = header.client;
  page.site = header.site;
  page.voxel_size_m = diff.voxel_size_m;
  const auto count = [&](io::PointChange change) { return diff.changes[static_cast<std::size_t>(change)]; };
  page.sentences = {"The earlier map has " + std::to_string(diff.points_before) + " surface points, the later one " +
                        std::to_string(diff.points_after) + "; " + std::to_string(diff.same) + " have the same label.",
                    std::string("Of those that both have, ") +
                        (diff.tools.empty() ? "the tool reaches " : "one of the tools reaches ") +
                        std::to_string(count(io::PointChange::Opened)) +
                        " that it did not reach before, and no longer " +
                        std::to_string(count(io::PointChange::Closed)) + "."};
  for (const std::string& parameter : diff.other_parameters)
    page.warnings.push_back("The maps were made with different parameters: " + parameter);
  constexpr const char* kMeanings[io::kNumPointChanges] = {
      "reached now, and was not", "was reached, and is not now", "blocked before and not scored now, or the reverse",
      "surface where the earlier map has none", "surface of the earlier map that the later one has not"};
  page.marks = {{"opened", "#1a7f37"},
                {"closed", "#c62828"},
                {"relabelled", "#8e6bbf"},
                {"appeared", "#1f6feb"},
                {"gone", "#d9822b"}};
  io::ResultPage::Table kinds = {"What happened", {"change", "points", "meaning"}, {}};
  for (int n = 0; n < io::kNumPointChanges; ++n) {
    const auto change = static_cast<io::PointChange>(n);
    kinds.rows.push_back({name(change), std::to_string(count(change)), kMeanings[n]});
  }
  io::ResultPage::Table reasons = {"By label and reason", {"before", "after", "points"}, {}};
  for (const auto& transition : diff.transitions) {
    reasons.rows.push_back({stateInWords(transition.label_before, transition.reason_before),
                            stateInWords(transition.label_after, transition.reason_after),
                            std::to_string(transition.points)});
  }
  page.tables = {kinds};
  if (!diff.tools.empty()) {
    io::ResultPage::Table tools = {"By tool", {"tool", "reached now, and was not", "was reached, and is not now"}, {}};
    for (const auto& tool : diff.tools)
      tools.rows.push_back({tool.name, std::to_string(tool.opened), std::to_string(tool.closed)});
    page.tables.push_back(tools);
  }
  page.tables.push_back(reasons);
  page.visit = [&diff, after](const io::ResultPage::TakeMarked& take) {
    for (const fs::path& file : after) {
      io::visitPoints(file, [&](const SurfacePoint& point) { take(point.position_W, std::nullopt); });
    }
    for (const io::ChangedPoint& changed : diff.points)
      take(changed.point.position_W, static_cast<std::size_t>(changed.change));
  };
  return page;
}

}  // namespace

int runDiff(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  std::string before, after, out;
  bool json = false, html = false, allow_changed = false;
  PageHeader header;
  FlagParser flags;
  flags.describe("diff",
                 "Compares two maps of the same place, by the same tool and voxel size: which points opened, closed, "
                 "appeared or are gone. Folders of accessvdb map, in one piece or in tiles.",
                 "accessvdb diff out/spring out/autumn --out out/changes\n"
                 "  accessvdb diff out/spring out/autumn --out out/changes --html --client \"City of X\"");
  addCommonOptions(flags, common);
  flags.option("BEFORE", &before, "folder of the earlier map");
  flags.option("AFTER", &after, "folder of the later map");
  flags.option("--out", &out, "folder for diff.ply, diff.vdb and diff.json; without it only the table is printed");
  flags.flag("--html", html, "with --out: also write diff.html, a page to send");
  addPageHeader(flags, header, "What changed");
  flags.flag("--json", json, "print the table as JSON");
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);
  if (before.empty() || after.empty()) {
    throw InvalidArgument("usage.missing", "diff", "needs two folders", "Name the earlier map, then the later one");
  }
  if (html && out.empty()) {
    throw InvalidArgument("usage.missing", "--html", "needs a folder to write into", "Add --out");
  }
  if (!out.empty()) {
    Paths outputs = inFolder(out, {"diff.ply", "diff.vdb", "diff.json"});
    if (html) outputs.push_back(fs::path(out) / "diff.html");
    requireNoInputs(outputs, joined(joined(filesOfMap(before), filesOfMap(after)), {common.config}));
    requireOwn(outputs);
    io::prepareOutputFolder(out);
  }

  io::OutputCheck check(allow_changed);
  const std::vector<fs::path> files_before = pointFilesOf(before, "diff", kWhyWhole, check, messages);
  const std::vector<fs::path> files_after = pointFilesOf(after, "diff", kWhyWhole, check, messages);
  const io::PointsDiff diff = io::readChecked(check, [&] { return io::diffPoints(files_before, files_after); });
  sayFindings(check, messages);
  warnIfApart(diff, messages);
  for (const std::string& parameter : diff.other_parameters) {
    messages.warning("diff.parameters", "the maps were made with different parameters: " + parameter);
  }
  endOnStopSignals(messages);
  if (!out.empty()) {
    const fs::path folder = out;
    io::writeDiffPly(folder / "diff.ply", diff);
    io::writeDiffVdb(folder / "diff.vdb", diff);
    io::writeFileDurably(folder / "diff.json",
                         [&](std::ostream& stream) { stream << jsonText(jsonDiff(diff), 2) << "\n"; });
    if (html) {
      const std::string page = io::htmlOf(pageOf(diff, files_after, header));
      io::writeFileDurably(folder / "diff.html", [&](std::ostream& stream) { stream << page; });
    }
    messages.notice(std::string("wrote diff.ply, diff.vdb") + (html ? ", diff.json and diff.html" : " and diff.json") +
                    " into " + out);
  }
  printData(json ? jsonText(jsonDiff(diff), 2) + "\n" : wordsOf(diff));
  return 0;
}

}  // namespace accessvdb::tools
