// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb views: where to look next.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/next_views.h"
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

constexpr double kRadians = std::numbers::pi / 180;

std::string lineOf(const NextView& view, std::size_t number) {
  const Eigen::Vector3d& p_W = view.T_W_S.translation();
  const Eigen::Vector3d x_W = view.T_W_S.linear().col(0);
  char text[320];
  std::snprintf(text, sizeof text, "%zu  at %.3f %.3f %.3f, yaw %.0f, pitch %.0f degrees: %s", number, p_W.x(), p_W.y(),
                p_W.z(), std::round(std::atan2(x_W.y(), x_W.x()) / kRadians) + 0.0,
                std::round(std::asin(std::clamp(x_W.z(), -1.0, 1.0)) / kRadians) + 0.0, view.why.c_str());
  std::string line = text;
  if (view.travel_m > 0) {
    std::snprintf(text, sizeof text, "; %.2f m away, straight there %s", view.travel_m,
                  view.way_is_free ? "is known free" : "is not known free");
    line += text;
  }
  return line + "\n";
}

std::vector<double> inRadians(std::vector<double> angles_deg) {
  for (double& angle : angles_deg) angle *= kRadians;
  return angles_deg;
}

}  // namespace

int runViews(const Arguments& arguments, Messages& messages) {
  CommonOptions common;
  MapOptions given;
  ViewOptions options;
  std::string map, out, from, elevation = "-7,52", pitches = "0";
  int most = 5;
  double azimuth_deg = 360;
  bool json = false, allow_changed = false;
  FlagParser flags;
  flags.describe("views",
                 "Where to look next: poses of the sensor from which points would resolve that were seen too rarely, "
                 "from the wrong side, or with unknown space before them. Never a pose at which the body is not known "
                 "to be free: map with --clear-rays and --platform-radius.",
                 "accessvdb views --map checkpoint/ --tool builtin:pruner --body 0.35 --from 0,0,1.5 --out views/\n"
                 "  accessvdb views --map checkpoint/ --tool pruner.stl --tool-unit mm --azimuth 70 --elevation -20,20 "
                 "--pitches -30,0,30 --json");
  addCommonOptions(flags, common);
  flags.option("--map", &map, "folder of map --checkpoint, or a state file");
  addToolsOptions(flags, given);
  addOrientationOptions(flags, given);
  flags.option("--most", &most, "how many views");
  flags.option("--azimuth", &azimuth_deg, "the sensor's field of view around its vertical axis, degrees in all");
  flags.option("--elevation", &elevation, "LOW,HIGH of its field of view, degrees; -52,7 if it hangs upside down");
  flags.option("--pitches", &pitches, "A,B,... at which it can be held: degrees above level");
  flags.option("--rays", &options.sensor.rays, "what it measures at a place: 200000 is a Mid-360 that stays a second");
  flags.option("--reach", &options.sensor.max_range_m,
               "how far it measures, metres, if less than the map's --max-range");
  flags.option("--body", &options.body_radius_m,
               "radius of what carries it, metres; 0 = rule: the map's --platform-radius, or 0.3");
  flags.option("--from", &from, "X,Y,Z where it is now");
  flags.option("--within", &options.within_m, "only poses so near to --from, metres");
  flags.option("--travel", &options.travel_m,
               "metres of flight that one view is worth; 0 = rule: 10; inf: ways cost nothing");
  flags.option("--out", &out, "folder for views.json, views.csv and views.ply");
  flags.flag("--json", json, "print the answer as JSON");
  addAllowChanged(flags, allow_changed);
  if (!parseCommandLine(flags, arguments, common, messages)) return 0;
  checkCommonOptions(common);
  if (map.empty())
    throw InvalidArgument("usage.missing", "--map", "is missing", "Name the folder of accessvdb map --checkpoint");
  if (most < 1) throw InvalidArgument("usage.number", "--most", "is less than 1", "Use 1 or more");
  options.most = static_cast<std::size_t>(most);
  if (!from.empty()) options.from_W = parseVector("--from", from);
  options.sensor.azimuth_rad = azimuth_deg * kRadians;
  const std::vector<double> low_high = inRadians(parseNumbers("--elevation", elevation, {2}, "LOW,HIGH in degrees"));
  options.sensor.elevation_min_rad = low_high[0];
  options.sensor.elevation_max_rad = low_high[1];
  options.sensor.pitches_rad =
      inRadians(parseNumbers("--pitches", pitches, {1, 2, 3, 4, 5, 6, 7, 8}, "one to eight angles in degrees"));
  endOnStopSignals(messages);
  const fs::path file = stateFile(map, "usage.views", "no view can be proposed", {allow_changed, messages});
  given.common = common;
  if (!out.empty()) {
    const Paths outputs = inFolder(out, {"views.json", "views.csv", "views.ply"});
    requireNoInputs(outputs, joined(namedInputs(given), filesOfMap(map)));
    requireOwn(outputs);
    io::prepareOutputFolder(out);
  }
  const AccessibilityField field = loadField(file, given, common, messages);
  const NextViews found = nextViews(field, options);
  if (found.views.empty()) {
    messages.warning("views.nothing", "none of " + std::to_string(found.tried) + " poses would resolve any of " +
                                          std::to_string(found.unresolved()) + " points");
  }
  if (!out.empty()) {
    io::writeViews(out, found);
    messages.notice("wrote views.json, views.csv and views.ply into " + out);
  }
  if (json) {
    printData(io::viewsJson(found));
    return 0;
  }
  std::string text;
  for (std::size_t n = 0; n < found.views.size(); ++n) text += lineOf(found.views[n], n);
  text += std::to_string(found.unresolved()) + " unresolved points: " + std::to_string(found.confidence) +
          " seen too rarely, " + std::to_string(found.unseen) + " from the wrong side, " +
          std::to_string(found.unknown) + " with unknown space before them\n";
  printData(text);
  return 0;
}

}  // namespace accessvdb::tools
