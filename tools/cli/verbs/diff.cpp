// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb diff: what changed between two maps of the same place.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "accessvdb/error.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/points_diff.h"
#include "options/command_line.h"
#include "options/options.h"
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

}  // namespace

int runDiff(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  std::string before, after, out;
  bool json = false, allow_changed = false;
  FlagParser flags;
  flags.describe("diff",
                 "Compares two maps of the same place, by the same tool and voxel size: which points opened, closed, "
                 "appeared or are gone. Folders of accessvdb map, in one piece or in tiles.",
                 "accessvdb diff out/spring out/autumn --out out/changes");
  addCommonOptions(flags, common);
  flags.option("BEFORE", &before, "folder of the earlier map");
  flags.option("AFTER", &after, "folder of the later map");
  flags.option("--out", &out, "folder for diff.ply, diff.vdb and diff.json; without it only the table is printed");
  flags.flag("--json", json, "print the table as JSON");
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);
  if (before.empty() || after.empty()) {
    throw InvalidArgument("usage.missing", "diff", "needs two folders", "Name the earlier map, then the later one");
  }
  if (!out.empty()) {
    const Paths outputs = inFolder(out, {"diff.ply", "diff.vdb", "diff.json"});
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
    messages.notice("wrote diff.ply, diff.vdb and diff.json into " + out);
  }
  printData(json ? jsonText(jsonDiff(diff), 2) + "\n" : wordsOf(diff));
  return 0;
}

}  // namespace accessvdb::tools
