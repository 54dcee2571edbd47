// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb tile: a map in tiles step by step, so that many processes or machines can share the work.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <random>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/surface_points.h"
#include "options/command_line.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/report.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/first_returns.h"
#include "runs/gpu_fallback.h"
#include "runs/memory_check.h"
#include "runs/scan_stamps.h"
#include "runs/tile_correction.h"
#include "runs/tile_job.h"
#include "runs/tile_requests.h"
#include "runs/tiled_map.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Flags of the steps after the plan.
struct StepOptions {
  MapOptions map;  ///< out, device, threads, max_memory
  std::vector<std::string> tiles;
  std::string points, vdb;
  bool todo = false, worker = false, keep_rays = false, partial = false;
};

/// OUT and the common flags. @return false if --help was given and printed
bool parseStep(FlagParser& flags, StepOptions& options, const Arguments& arguments, Messages& messages) {
  addCommonOptions(flags, options.map.common);
  flags.option("OUT", &options.map.out, "folder of the plan");
  if (!parseCommandLine(flags, arguments, options.map.common, messages)) return false;
  checkCommonOptions(options.map.common);
  if (options.map.out.empty()) {
    throw InvalidArgument("usage.missing", "OUT", "is missing", "Name the folder of accessvdb tile plan");
  }
  return true;
}

/// Rays of the plan. @throws InputError "rays.missing"
tiles::Binned raysOf(const tiles::Job& job) {
  auto rays = tiles::binned(job.out, job.plan);
  if (rays) return *rays;
  throw InputError("rays.missing", job.out.string(), "holds no rays of this plan yet",
                   "Run accessvdb tile bin " + job.out.string() + " first");
}

/// What the plan was made from, and what is made from it.
Paths inputsOf(const tiles::Plan& plan) {
  Paths inputs;
  for (const tiles::Flight& flight : plan.flights) {
    for (const tiles::PlannedInput& input : flight.inputs) inputs.emplace_back(input.path);
  }
  return inputs;
}

/// As much memory as there is now, unless --max-memory says it.
tiles::RunLimits runLimits(const OpenJob& open, const MapOptions& given) {
  return {memoryLimit(given).value_or(0), writeOptions(open.options.exported)};
}

constexpr std::chrono::seconds kIdle{10};  ///< docs/large_maps.md says it

/// Tiles that a parent names; each name is printed when its tile is finished. A tile that fails ends the process.
void runForParent(const OpenJob& open, const tiles::Binned& rays, const MapOptions& given, Messages& messages) {
  TileRequests requests;
  while (const auto name = requests.next(kIdle)) {
    runWithProgress({open.job, rays, runLimits(open, given)}, {tiles::TileId::parse(*name)}, messages);
    if (stopSignal() != 0) {
      messages.notice("stopped in tile " + *name + ", by a signal or because standard input ended");
      return;
    }
    printData(*name + "\n");
  }
}

int planTiles(const Arguments& arguments, Messages& messages) {
  MapOptions options;
  bool append = false;
  FlagParser flags;
  flags.describe(
      "tile plan", "Decides the tiles of a map and writes OUT/plan.json.",
      "accessvdb tile plan out/ --scans scans/ --poses poses.txt --tool builtin:pruner --voxel 0.02 "
      "--max-memory 8G\n"
      "  accessvdb tile plan out/ --append --scans flight2/scans --poses flight2/poses.txt\n"
      "  accessvdb tile plan out/ --poses corrected.txt    (then bin, run and merge again: what moved is made anew)");
  addCommonOptions(flags, options.common);
  addMapFlags(flags, options, "OUT");
  flags.flag("--append", append, "add the scans of another flight to the plan in OUT; nothing else may be given");
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  watchStopSignals();
  if (append) {
    io::prepareOutputFolder(options.out);
    appendFlight(options.out, options, flags, messages);
    return 0;
  }
  if (!options.out.empty() && givesPosesAlone(options)) {
    io::prepareOutputFolder(options.out);
    return correctPoses(options.out, options, flags, messages);
  }
  checkMapOptions(options);
  sayWhatNeedsGpu(options, nullptr, messages);
  requireNoInputsInTiles(options.out, namedInputs(options));
  const std::vector<ToolSpec> tools = loadTools(options);
  sayToolsNotes(options, tools, messages);
  requireClosedTools(options, tools);
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(options));
  requireNoInputsInTiles(options.out, inputsWith(options, scans));
  io::prepareOutputFolder(options.out);
  sayAboutScans(scans, messages);
  FieldParams params = fieldParams(options, scans.recordedRangeNoise_m());
  addFirstReturns(scans.frame(), params);
  if (const auto reason = whyNotInTiles(options, params)) {
    throw InvalidArgument("usage.tiles", "tile plan", *reason, "Leave that option out");
  }
  sayChangeNotes(params, messages);
  requireStamps(options, params, scans, messages);
  static_cast<void>(checkAgreement(options, params.tsdf.range_noise_m, scans, messages));
  const PlanSettings settings = planSettings(flags);
  const PlanSources sources = {options, settings, tools, scans, params};
  std::int32_t edge = 0;
  if (wantedTile_m(options) == 0 && (options.fresh || !tiles::hasPlan(options.out))) {
    const tiles::TileMargins margins = tiles::tileMargins(tools, params, tableProgress(messages));
    const auto memory = checkMemory(
        options, tools, RunOutput::Field, scans, [&] { return margins; }, messages);
    if (!memory) return 128 + stopSignal();
    // What fits in one piece is still to be shared: four tiles at least, unless they would be smaller than is useful.
    const bool full = params.change.mode == ChangeMode::Full;
    edge = memory->tile_voxels > 0 ? memory->tile_voxels
           : full                  ? tiles::edgeSideBySide(margins, params)
                                   : margins.least_tile_voxels * 4;
  }
  (void)planOf(sources, edge, messages);
  return 0;
}

int binScans(const Arguments& arguments, Messages& messages) {
  StepOptions options;
  FlagParser flags;
  flags.describe("tile bin", "Reads every scan once and sorts its returns by tile, into OUT/rays.",
                 "accessvdb tile bin out/");
  flags.option("--max-memory", &options.map.max_memory,
               "limit on memory with --change full, for which all tiles take the scans side by side");
  if (!parseStep(flags, options, arguments, messages)) return 0;
  io::prepareOutputFolder(options.map.out);
  watchStopSignals();
  const OpenJob open = openJob(options.map.out, options.map);
  requireNoInputsInTiles(open.job.out, inputsOf(open.job.plan));
  const OpenScans scans(open, messages);
  const auto limit_bytes = memoryLimit(options.map);
  return binWithProgress(open.job, scans.flights(), limit_bytes, messages).complete ? 0 : 128 + stopSignal();
}

int runTiles(const Arguments& arguments, Messages& messages) {
  StepOptions options;
  FlagParser flags;
  flags.describe("tile run", "Maps tiles, each into a folder of its own in OUT/tiles. Without --tile: all of them.",
                 "accessvdb tile run out/ --tile 3_-2 --max-memory 4G");
  flags.list("--tile", options.tiles, "name of a tile, as accessvdb tile list prints it; may be repeated");
  flags.option("--max-memory", &options.map.max_memory,
               "limit on memory; a tile that needs more is run as quarters, but with --change full");
  flags.flag(
      "--worker", options.worker,
      "run the tiles that standard input names, a line each, and print each name when it is done; stop when it ends");
  if (!parseStep(flags, options, arguments, messages)) return 0;
  if (options.worker && !options.tiles.empty()) {
    throw InvalidArgument("usage.conflict", "--worker", "runs the tiles that standard input names, not those of --tile",
                          "Leave one out");
  }
  std::vector<tiles::TileId> wanted;
  for (const std::string& name : options.tiles) wanted.push_back(tiles::TileId::parse(name));
  watchStopSignals();
  const OpenJob open = openJob(options.map.out, options.map);
  requireNoInputsInTiles(open.job.out, inputsOf(open.job.plan));
  const tiles::Binned rays = raysOf(open.job);
  if (options.worker) {
    runForParent(open, rays, options.map, messages);
  } else {
    if (wanted.empty()) wanted = tiles::status(open.job.out, open.job.plan, rays).todo;
    runWithProgress({open.job, rays, runLimits(open, options.map)}, wanted, messages);
  }
  return stopSignal() == 0 ? 0 : 128 + stopSignal();
}

int listTiles(const Arguments& arguments, Messages& messages) {
  StepOptions options;
  FlagParser flags;
  flags.describe("tile list", "Prints the names of the tiles, most returns first, one per line.",
                 "accessvdb tile list out/ --todo");
  flags.flag("--todo", options.todo, "only those that are not finished");
  if (!parseStep(flags, options, arguments, messages)) return 0;
  const OpenJob open = openJob(options.map.out, options.map);
  const tiles::Status status = tiles::status(open.job.out, open.job.plan, raysOf(open.job));
  std::string text;
  for (const tiles::TileId& tile : status.todo) text += tile.name() + "\n";
  if (!options.todo) {
    for (const tiles::Tile& tile : status.done) text += tile.id.name() + "\n";
  }
  printData(text);
  return 0;
}

int showStatus(const Arguments& arguments, Messages& messages) {
  StepOptions options;
  FlagParser flags;
  flags.describe("tile status", "Says how far a map in tiles has come.", "accessvdb tile status out/");
  if (!parseStep(flags, options, arguments, messages)) return 0;
  const OpenJob open = openJob(options.map.out, options.map);
  const auto rays = tiles::binned(open.job.out, open.job.plan);
  if (!rays) {
    printData("planned: " + std::to_string(open.job.plan.steps()) + " steps; next: accessvdb tile bin\n");
    return 0;
  }
  const tiles::Status status = tiles::status(open.job.out, open.job.plan, *rays);
  double seconds = 0;
  std::uint64_t points = 0;
  for (const tiles::Tile& tile : status.done) {
    seconds += tile.seconds;
    points += tile.points;
  }
  const std::size_t all = status.done.size() + status.todo.size();
  const std::string next = status.todo.empty() ? "merge" : tiles::hasRays(open.job, *rays) ? "run" : "bin";
  printData(std::to_string(status.done.size()) + " of " + std::to_string(all) + " tiles done, " +
            std::to_string(points) + " points, " + numberText(std::round(seconds)) + " s; next: accessvdb tile " +
            next + "\n");
  for (const tiles::Poison& tile : status.poison) {
    printData("given up: " + tile.id.name() + ", code " + std::to_string(tile.exit_code) + ": " + tile.reason + "\n");
  }
  return 0;
}

/// The points that --vdb without --points needs for itself. Named as files that are being written, of which
/// io::prepareOutputFolder() removes what a killed process left.
class PointsForGrids {
 public:
  explicit PointsForGrids(const fs::path& folder) {
    std::random_device random;
    std::error_code ignored;
    do {
      char name[64];
      std::snprintf(name, sizeof name, ".merged_points.ply.%08x%08x.tmp", random(), random());
      path_ = folder / name;
    } while (fs::exists(fs::symlink_status(path_, ignored)));
  }
  ~PointsForGrids() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  PointsForGrids(const PointsForGrids&) = delete;
  PointsForGrids& operator=(const PointsForGrids&) = delete;
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

void mergeFiles(const OpenJob& open, const StepOptions& options, const tiles::Status& status, Messages& messages) {
  if (!options.vdb.empty()) requireRoomForGrids(status, memoryLimit(options.map));
  const auto merge = [&](const fs::path& file) {
    return tiles::mergePoints(open.job.out, open.job.plan, status.done, file);
  };
  const fs::path named = options.points;
  if (!named.empty()) messages.notice("wrote " + std::to_string(merge(named)) + " points into " + named.string());
  if (options.vdb.empty()) return;
  const PointsForGrids own(open.job.out);
  const bool have_ply = !named.empty() && named.extension() != ".las";
  if (!have_ply) merge(own.path());
  tiles::mergeGrids({open.job.out, status.done, have_ply ? named : own.path(), options.vdb,
                     writeOptions(open.options.exported), options.map.common.threads});
  messages.notice("wrote all grids into " + options.vdb);
}

/// The tiles themselves are inputs, too; files of one piece in the same folder are not.
void requireNoInputsOfMerge(const OpenJob& open, const StepOptions& options) {
  const fs::path& out = open.job.out;
  const Paths planned = inputsOf(open.job.plan);
  requireNoInputsInTiles(out, planned);
  Paths read = filesOfMap(out);
  std::erase_if(read, [&](const fs::path& path) {
    return path.parent_path() == out && path.extension() != ".json";  // an earlier merge of the same name
  });
  Paths named;
  for (const std::string& file : {options.points, options.vdb}) {
    if (!file.empty()) named.emplace_back(file);
  }
  requireNoInputs(named, joined(planned, read));
  requireNotInTiles(out, named);
  const Paths own = inFolder(out, {"preview.png", "report.json"});
  requireDistinct(joined(named, own));
  requireOwn(own);
}

int mergeTiles(const Arguments& arguments, Messages& messages) {
  StepOptions options;
  FlagParser flags;
  flags.describe("tile merge",
                 "Writes OUT/field.json, preview.png and report.json, and on demand one file of all tiles.",
                 "accessvdb tile merge out/ --points all.ply --vdb all.vdb");
  flags.option("--points", &options.points,
               "all points in one file, the points.ply of one piece; as points.las if it is named .las");
  flags.option("--vdb", &options.vdb, "all grids in one field.vdb, if they fit into memory");
  flags.option("--max-memory", &options.map.max_memory, "limit on memory for --vdb");
  flags.flag("--keep-rays", options.keep_rays, "keep the sorted returns");
  flags.flag("--partial", options.partial, "merge what is finished, although tiles are left; the report names them");
  if (!parseStep(flags, options, arguments, messages)) return 0;
  io::prepareOutputFolder(options.map.out);
  watchStopSignals();
  const OpenJob open = openJob(options.map.out, options.map);
  requireNoInputsOfMerge(open, options);
  const tiles::Binned rays = raysOf(open.job);
  const tiles::Status status = tiles::status(open.job.out, open.job.plan, rays);
  const std::size_t left = status.todo.size();
  if (left > 0 && options.partial) {
    messages.warning("tile.unfinished", std::to_string(left) + " tiles are not finished, the first is " +
                                            status.todo.front().name() + "; only the others are merged");
  } else if (left > 0) {
    throw UnusableInput("tile.unfinished", open.job.out.string(),
                        std::to_string(left) + " tiles are not finished, the first is " + status.todo.front().name(),
                        "Run accessvdb tile run first, or merge the others with --partial");
  }
  if (!options.points.empty() || !options.vdb.empty()) mergeFiles(open, options, status, messages);
  RunReport report;
  report.device.clear();
  for (const std::string& file : {options.points, options.vdb}) {
    if (const std::string name = nameInFolder(open.job.out, file); !name.empty()) {
      addOutputs(report.outputs, open.job.out, {name});
    }
  }
  writeResult({open.job, open.options, rays, status}, report, messages);
  writeReport(open.job.out / "report.json", report, messages);
  tiles::removeLeftovers(open.job.out);
  tiles::removeOutdated(open.job.out, status);
  // Last, because a tile that turns out to be damaged is made again from them.
  if (!options.keep_rays && left == 0) tiles::removeRays(open.job.out);
  return 0;
}

struct Step {
  const char* name;
  const char* purpose;
  int (*run)(const Arguments&, Messages&);
};
constexpr Step kSteps[] = {
    {"plan", "decides the tiles of a map", planTiles}, {"bin", "sorts all returns by tile", binScans},
    {"run", "maps tiles, in any order", runTiles},     {"list", "names of the tiles", listTiles},
    {"status", "how far it has come", showStatus},     {"merge", "one result from all tiles", mergeTiles},
};

std::string stepsInWords() {
  std::string text =
      "Maps larger than memory, step by step; accessvdb map --tiles does all of it in one go.\n\n"
      "Usage: accessvdb tile STEP OUT [options]\n\nSteps:\n";
  for (const Step& step : kSteps) {
    text += std::string("  ") + step.name + std::string(10 - std::string(step.name).size(), ' ') + step.purpose + "\n";
  }
  return text + "\naccessvdb tile STEP --help lists a step's options.\n";
}

}  // namespace

int runTile(const Arguments& arguments, Messages& messages) {
  const std::string word = arguments.empty() ? std::string() : arguments.front();
  if (word == "--help" || word == "-h") {
    printData(stepsInWords());
    return 0;
  }
  for (const Step& step : kSteps) {
    if (word == step.name) return step.run(Arguments(arguments.begin() + 1, arguments.end()), messages);
  }
  throw InvalidArgument("usage.verb", "tile " + word,
                        "is not a step; the steps are plan, bin, run, list, status, merge",
                        "See accessvdb tile --help");
}

}  // namespace accessvdb::tools
