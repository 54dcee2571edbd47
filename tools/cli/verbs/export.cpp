// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb export: a result in the formats of other programs.
#include <cstdint>
#include <filesystem>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/program/points_mcap.h"
#include "accessvdb/scan_io.h"
#include "options/command_line.h"
#include "options/map_options.h"
#include "options/options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/gis_files.h"
#include "runs/octomap_file.h"
#include "runs/point_files.h"
#include "runs/state_file.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// With 24 attributes a point has some 120 bytes.
constexpr std::uint64_t kMostMcapPoints = 10'000'000;

struct ExportFiles {
  CommonOptions common;
  MapOptions given;  ///< the tool of a state
  std::string map, raster, vector, mcap, octomap, crs;
  double cell_m = 0.5;
  io::McapOptions of_mcap;
  bool allow_changed = false;
};

void requireEnding(const std::string& flag, const std::string& file, const std::string& ending) {
  if (file.empty() || fs::path(file).extension() == ending) return;
  throw InvalidArgument("usage.ending", flag + " " + file, "does not end in " + ending, "Name a file " + ending);
}

void checkOptions(const ExportFiles& options) {
  checkCommonOptions(options.common);
  if (options.map.empty())
    throw InvalidArgument("usage.missing", "--map", "is missing", "Name the output folder of accessvdb map");
  const bool others = !options.raster.empty() || !options.vector.empty() || !options.mcap.empty();
  if (options.octomap.empty() && !others) {
    throw InvalidArgument("usage.missing", "export", "needs a file to write",
                          "Give --raster, --vector, --mcap or --octomap");
  }
  if (!options.octomap.empty() && others) {
    throw InvalidArgument("usage.octomap", "--octomap", "is made from a checkpoint, and the other files from results",
                          "Run export once for each");
  }
  const ExportFiles plain;
  const bool of_others = !options.crs.empty() || options.cell_m != plain.cell_m ||
                         options.of_mcap.most_points != plain.of_mcap.most_points ||
                         options.of_mcap.most_arrows != plain.of_mcap.most_arrows;
  if (!options.octomap.empty() && of_others) {
    throw InvalidArgument("usage.octomap", "--octomap", "goes with none of --crs, --cell, --max-points and --arrows",
                          "Leave them out");
  }
  const MapOptions& given = options.given;
  const bool of_tool = !given.tool.tool.empty() || !given.tool.unit.empty() || !given.tool_name.empty() ||
                       !given.margins.empty() || !given.max_collisions.empty() || !given.orientations.empty() ||
                       !given.rolls.empty() || given.directions;
  if (options.octomap.empty() && of_tool)
    throw InvalidArgument("usage.octomap", "--tool", "and what goes with it is for --octomap alone", "Leave it out");
  requireEnding("--octomap", options.octomap, ".bt");
  requireEnding("--raster", options.raster, ".tif");
  requireEnding("--vector", options.vector, ".gpkg");
  requireEnding("--mcap", options.mcap, ".mcap");
  if (options.of_mcap.most_points == 0 || options.of_mcap.most_points > kMostMcapPoints)
    throw InvalidArgument("usage.max_points", "--max-points", "is not between 1 and " + std::to_string(kMostMcapPoints),
                          "Use fewer points: a message ends at 2 GB");
  if (!(options.cell_m >= 0.001 && options.cell_m <= 1e6))
    throw InvalidArgument("usage.cell", "--cell", "is not between 0.001 and 1000000 metres", "Use metres, such as 0.5");
}

/// What is free and what is not, as the map itself knows it.
int exportOctomap(ExportFiles& options, Messages& messages) {
  requireOctomap("--octomap");
  const fs::path file =
      stateFile(options.map, "usage.octomap", "free space is not known", {options.allow_changed, messages});
  const Paths outputs = {options.octomap};
  requireNoInputs(outputs, joined(namedInputs(options.given), filesOfMap(options.map)));
  requireOwn(outputs);
  endOnStopSignals(messages);
  options.given.common = options.common;
  const PreparedFile made = octomapFile(options.octomap, loadField(file, options.given, options.common, messages));
  io::writeFileDurably(made.path, made.write);
  messages.notice("wrote " + made.path.string() + " with " + made.words);
  return 0;
}

/// What points.las says, beside the first points.ply that has one.
SurveyFrame frameOf(const std::vector<fs::path>& points, Messages& messages) {
  for (const fs::path& ply : points) {
    const fs::path las = ply.parent_path() / "points.las";
    if (!io::isFile(las)) continue;
    SurveyFrame frame = io::frameOfLas(las);
    if (frame.hasSystem()) return frame;
  }
  messages.warning("export.no_frame",
                   "no points.las says in which coordinate system the map is, nor does --crs: the files say none");
  return {};
}

PreparedFile mcapFile(const fs::path& file, const std::vector<fs::path>& points, const io::McapOptions& options) {
  const auto made = std::make_shared<const io::PointsMcap>(io::pointsMcap(points, options));
  const auto ofAll = [](std::uint64_t shown, std::uint64_t all) {
    return std::to_string(shown) + (shown == all ? "" : " of " + std::to_string(all));
  };
  return {file, ofAll(made->shown, made->points) + " points and " + ofAll(made->arrows, made->accessible) + " arrows",
          [made](std::ostream& out) {
            out.write(made->content.data(), static_cast<std::streamsize>(made->content.size()));
          }};
}

}  // namespace

int runExport(const Arguments& arguments, Messages& messages) {
  ExportFiles options;
  FlagParser flags;
  flags.describe("export",
                 "Writes a field for other programs: a GeoTIFF and a GeoPackage for QGIS, in the coordinate system of "
                 "the survey; an MCAP file for Foxglove and Rerun; an OctoMap for MoveIt and Nav2.",
                 "accessvdb export --map out/ --raster share.tif --cell 1\n"
                 "  accessvdb export --map out/ --vector targets.gpkg --crs EPSG:32612\n"
                 "  accessvdb export --map out/ --mcap field.mcap\n"
                 "  accessvdb export --map checkpoint/ --tool builtin:pruner --octomap map.bt");
  addCommonOptions(flags, options.common);
  flags.option("--map", &options.map, "output folder of accessvdb map; for --octomap, of map --checkpoint");
  flags.option("--raster", &options.raster,
               "GeoTIFF to write: seen from above, the accessible share of the surface, and its square metres");
  flags.option("--cell", &options.cell_m, "edge of the raster's cells, in metres");
  flags.option("--vector", &options.vector,
               "GeoPackage to write: a layer of the accessible points, with score, direction and what --carry brought");
  flags.option("--crs", &options.crs,
               "coordinate system of the map: a code such as EPSG:32632 (needs proj-bin) or a file with well-known "
               "text; default: that of points.las");
  flags.option(
      "--mcap", &options.mcap,
      "MCAP file to write: the labelled points as foxglove.PointCloud, ways in to them as foxglove.SceneUpdate");
  flags.option("--octomap", &options.octomap,
               "OctoMap to write, of cells as large as voxels: what collides, what was seen to be free (more with map "
               "--clear-rays and --platform-radius), and nothing where that is unknown");
  addToolsOptions(flags, options.given);
  addOrientationOptions(flags, options.given);
  flags.option("--max-points", &options.of_mcap.most_points,
               "most points in the MCAP file; every second, third ... where there are more");
  flags.option("--arrows", &options.of_mcap.most_arrows, "the same for the arrows at accessible points; 0 = none");
  addAllowChanged(flags, options.allow_changed);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkOptions(options);
  if (!options.octomap.empty()) return exportOctomap(options, messages);
  const bool gis = !options.raster.empty() || !options.vector.empty();
  if (gis) requireGis(options.raster.empty() ? "--vector" : "--raster");
  Paths outputs;
  for (const std::string& file : {options.raster, options.vector, options.mcap}) {
    if (!file.empty()) outputs.emplace_back(file);
  }
  requireNoInputs(outputs, joined(filesOfMap(options.map), {options.common.config}));
  requireNotInTiles(options.map, outputs);
  requireOwn(outputs);

  io::OutputCheck check(options.allow_changed);
  const std::vector<fs::path> points =
      pointFilesOf(options.map, "export", "what is missing would count as if there were no surface", check, messages);
  SurveyFrame frame;
  if (gis) frame = options.crs.empty() ? frameOf(points, messages) : io::crsFrame(options.crs);
  endOnStopSignals(messages);
  const std::vector<PreparedFile> files = io::readChecked(check, [&] {
    std::vector<PreparedFile> made;
    if (!options.raster.empty()) made.push_back(shareRaster(options.raster, points, frame, options.cell_m));
    if (!options.vector.empty()) made.push_back(targetLayer(options.vector, points, frame));
    if (!options.mcap.empty()) made.push_back(mcapFile(options.mcap, points, options.of_mcap));
    return made;
  });
  sayFindings(check, messages);
  for (const PreparedFile& file : files) {
    io::writeFileDurably(file.path, file.write);
    messages.notice("wrote " + file.path.string() + " with " + file.words);
  }
  return 0;
}

}  // namespace accessvdb::tools
