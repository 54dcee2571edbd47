// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb export: a result in the formats of other programs.
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"
#include "options/command_line.h"
#include "options/options.h"
#include "output/output_files.h"
#include "output/stop_signal.h"
#include "runs/checked_results.h"
#include "runs/gis_files.h"
#include "runs/point_files.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

struct ExportFiles {
  CommonOptions common;
  std::string map, raster, vector, crs;
  double cell_m = 0.5;
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
  if (options.raster.empty() && options.vector.empty())
    throw InvalidArgument("usage.missing", "export", "needs a file to write", "Give --raster or --vector");
  requireEnding("--raster", options.raster, ".tif");
  requireEnding("--vector", options.vector, ".gpkg");
  if (!(options.cell_m >= 0.001 && options.cell_m <= 1e6))
    throw InvalidArgument("usage.cell", "--cell", "is not between 0.001 and 1000000 metres", "Use metres, such as 0.5");
}

/// What points.las says, beside the first points.ply that has one.
SurveyFrame frameOf(const std::vector<fs::path>& points, Messages& messages) {
  for (const fs::path& ply : points) {
    const fs::path las = ply.parent_path() / "points.las";
    if (io::isFile(las)) return io::frameOfLas(las);
  }
  messages.warning("export.no_frame",
                   "no points.las says in which coordinate system the map is, nor does --crs: the files say none");
  return {};
}

}  // namespace

int runExport(const Arguments& arguments, Messages& messages) {
  ExportFiles options;
  FlagParser flags;
  flags.describe("export",
                 "Writes a field for other programs: a GeoTIFF and a GeoPackage for QGIS, in the coordinate system of "
                 "the survey.",
                 "accessvdb export --map out/ --raster share.tif --cell 1\n"
                 "  accessvdb export --map out/ --vector targets.gpkg --crs EPSG:32612");
  addCommonOptions(flags, options.common);
  flags.option("--map", &options.map, "output folder of accessvdb map");
  flags.option("--raster", &options.raster,
               "GeoTIFF to write: seen from above, the accessible share of the surface, and its square metres");
  flags.option("--cell", &options.cell_m, "edge of the raster's cells, in metres");
  flags.option("--vector", &options.vector,
               "GeoPackage to write: a layer of the accessible points, with score, direction and what --carry brought");
  flags.option("--crs", &options.crs,
               "coordinate system of the map: a code such as EPSG:32632 (needs proj-bin) or a file with well-known "
               "text; default: that of points.las");
  addAllowChanged(flags, options.allow_changed);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkOptions(options);
  requireGis(options.raster.empty() ? "--vector" : "--raster");
  Paths outputs;
  for (const std::string& file : {options.raster, options.vector}) {
    if (!file.empty()) outputs.emplace_back(file);
  }
  requireNoInputs(outputs, joined(filesOfMap(options.map), {options.common.config}));
  requireNotInTiles(options.map, outputs);
  requireOwn(outputs);

  io::OutputCheck check(options.allow_changed);
  const std::vector<fs::path> points =
      pointFilesOf(options.map, "export", "what is missing would count as if there were no surface", check, messages);
  const SurveyFrame frame = options.crs.empty() ? frameOf(points, messages) : io::crsFrame(options.crs);
  endOnStopSignals(messages);
  const std::vector<PreparedFile> files = io::readChecked(check, [&] {
    std::vector<PreparedFile> made;
    if (!options.raster.empty()) made.push_back(shareRaster(options.raster, points, frame, options.cell_m));
    if (!options.vector.empty()) made.push_back(targetLayer(options.vector, points, frame));
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
