// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb approaches: where a machine should go first, and how.
#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/approaches.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "options/command_line.h"
#include "options/map_options.h"
#include "options/options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/state_file.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

std::string lineOf(const ApproachTarget& target, std::size_t number, const std::vector<std::string>& tools) {
  char text[200];
  std::snprintf(text, sizeof text, "%zu  point %u at %.3f %.3f %.3f", number, target.point, target.position_W.x(),
                target.position_W.y(), target.position_W.z());
  std::string line = text;
  if (tools.size() > 1) line += ", " + tools[target.tool];
  line += ": " + target.why;
  const std::size_t others = target.approaches.size() - 1;
  if (others > 0) line += ", " + std::to_string(others) + (others == 1 ? " other way" : " other ways");
  return line + "\n";
}

}  // namespace

int runApproaches(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  MapOptions given;
  ApproachOptions options;
  std::string map, out, from;
  int most = 10, each = 3;
  bool json = false, allow_changed = false;
  FlagParser flags;
  flags.describe("approaches",
                 "Turns labels into what a machine can do next: targets spread over what the tool reaches, best first, "
                 "each with poses before contact, at contact and to retreat to. The way in has to be known free.",
                 "accessvdb approaches --map checkpoint/ --tool builtin:pruner --out approaches/\n"
                 "  accessvdb approaches --map checkpoint/ --tool pruner.stl --tool-unit mm --margins 0.02,0.05 "
                 "--from 0,0,1.5 --within 10 --most 5 --json");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "folder of map --checkpoint, or a state file");
  addToolsOptions(flags, given);
  addOrientationOptions(flags, given);
  flags.option("--most", &most, "how many targets, with --per for each value; 0: all");
  flags.option("--spacing", &options.spacing_m,
               "least distance between two targets, metres; 0 = rule: 0.25, or 5 voxels");
  flags.option("--stand-off", &options.stand_off_m,
               "how far before contact the pre-contact pose is, metres; 0 = rule: 0.3, or 8 voxels");
  flags.option("--each", &each, "most ways in for each target");
  flags.option("--from", &from, "X,Y,Z of the machine: of targets that are otherwise alike, the nearest comes first");
  flags.option("--within", &options.within_m, "only targets so near to --from, metres");
  flags.option("--per", &options.per, "name that map --carry brought: targets are ranked for each of its values");
  flags.flag("--allow-unknown", options.allow_unknown,
             "also ways through space that nothing is known of: see map --clear-rays");
  flags.option("--out", &out, "folder for approaches.json, approaches.csv and approaches.ply");
  flags.flag("--json", json, "print the answer as JSON");
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);
  if (map.empty())
    throw InvalidArgument("usage.missing", "--map", "is missing", "Name the folder of accessvdb map --checkpoint");
  for (const auto& [flag, value] : {std::pair{"--most", most}, {"--each", each}}) {
    if (value < 0) throw InvalidArgument("usage.number", flag, "is negative", "Use 0 or more");
  }
  options.most = static_cast<std::size_t>(most);
  options.each = static_cast<std::size_t>(each);
  if (!from.empty()) options.from_W = parseVector("--from", from);
  endOnStopSignals(messages);
  const fs::path file = stateFile(map, "usage.approaches", "no way in can be tried", {allow_changed, messages});
  given.common = common;
  if (!out.empty()) {
    const Paths outputs = inFolder(out, {"approaches.json", "approaches.csv", "approaches.ply"});
    requireNoInputs(outputs, joined(namedInputs(given), filesOfMap(map)));
    requireOwn(outputs);
    io::prepareOutputFolder(out);
  }
  const AccessibilityField field = loadField(file, given, common, messages);
  const Approaches found = approaches(field, options);
  std::vector<std::string> tools;
  for (const ToolSpec& tool : field.tools()) tools.push_back(tool.name);
  if (found.targets.empty()) {
    messages.warning("approaches.no_way",
                     "no way to any of " + std::to_string(found.accessible) +
                         " accessible points was seen free up to contact. Map with --clear-rays and "
                         "--platform-radius, use a shorter --stand-off, or --allow-unknown");
  }
  if (!out.empty()) {
    io::writeApproaches(out, found, tools);
    messages.notice("wrote approaches.json, approaches.csv and approaches.ply into " + out);
  }
  if (json) {
    printData(io::approachesJson(found, tools));
    return 0;
  }
  std::string text;
  for (std::size_t n = 0; n < found.targets.size(); ++n) text += lineOf(found.targets[n], n, tools);
  text += std::to_string(found.targets.size()) + (found.targets.size() == 1 ? " target; " : " targets; ") +
          std::to_string(found.covered) + " of " + std::to_string(found.accessible) +
          " accessible points are nearer than the spacing to one" +
          (found.targets.size() == options.most ? ", those that --most leaves out included\n" : "\n");
  printData(text);
  return 0;
}

}  // namespace accessvdb::tools
