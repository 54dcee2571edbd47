// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab evaluate --pseudo-truth: recordings, for which there is no exact truth, judged by their dense halves.
#include <algorithm>
#include <charconv>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <optional>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "eval/pseudo_truth.h"
#include "eval/table_files.h"
#include "eval/tables.h"
#include "lab_verbs.h"
#include "options/command_line.h"
#include "options/map_options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/stop_signal.h"

namespace accessvdb::tools {
namespace {

constexpr const char* kPseudoTruth = "--pseudo-truth";

struct PseudoTruthOptions {
  MapOptions map;  ///< scans and poses are those of one recording at a time
  std::vector<std::string> recordings, poses, densities = {"1", "0.25", "0.0625"};
  std::string halves = "scans";
};

void addPseudoTruthOptions(FlagParser& flags, PseudoTruthOptions& options) {
  flags.describe(
      std::string("evaluate ") + kPseudoTruth,
      "Maps the sparse half of recordings, and judges its labels by what the dense half shows of the world.",
      "accessvdb-lab evaluate --pseudo-truth scans/ --poses poses.txt --tool builtin:pruner --voxel 0.03 --out out/");
  addCommonOptions(flags, options.map.common);
  flags.list(kPseudoTruth, options.recordings,
             "recordings: folders of .pcd, .ply, .bin, .las or .laz scans, ray clouds, or .mcap, .db3 and .bag",
             kBetweenValues);
  flags.list("--poses", options.poses,
             "pose file of each recording, in their order; may be omitted where none is needed (VIEWPOINT poses, ray "
             "clouds, recordings of ROS, --trajectory)",
             kBetweenValues);
  flags.option("--halves", &options.halves,
               "how a recording is halved: scans (every second one is sparse) or returns (drawn by lot; for one scan)");
  flags.list("--densities", options.densities, "shares of the sparse half's returns that are mapped, with commas", ',');
  addMappingOptions(flags, options.map);
  flags.option("--out", &options.map.out, "folder for tables.json and tables.md");
}

std::vector<double> densitiesOf(const PseudoTruthOptions& options) {
  std::vector<double> densities;
  for (const std::string& text : options.densities) {
    double share = 0;
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, share);
    if (error != std::errc() || rest != end || !(share > 0 && share <= 1)) {
      throw InvalidArgument("usage.densities", "--densities",
                            "\"" + printable(text) + "\" is not a share above 0 and up to 1",
                            "Use for example 1,0.25,0.0625");
    }
    densities.push_back(share);
  }
  return densities;
}

void checkPseudoTruthOptions(const PseudoTruthOptions& options) {
  checkCommonOptions(options.map.common);
  if (options.recordings.empty()) {
    throw InvalidArgument("usage.missing", kPseudoTruth, "names no recording", "Name a folder of scans or a recording");
  }
  for (const auto& [flag, value, what] :
       {std::tuple{"--tool", options.map.tool.tool, "a mesh, builtin:pencil or builtin:pruner"},
        std::tuple{"--out", options.map.out, "the folder for the tables"}}) {
    if (value.empty()) throw InvalidArgument("usage.missing", flag, "is missing", std::string("Name ") + what);
  }
  if (!options.poses.empty() && options.poses.size() != options.recordings.size()) {
    throw InvalidArgument("usage.poses", "--poses",
                          "there are " + std::to_string(options.poses.size()) + " pose files for " +
                              std::to_string(options.recordings.size()) + " recordings",
                          "Name one for each recording, in their order, or none");
  }
  if (options.halves != "scans" && options.halves != "returns") {
    throw InvalidArgument("usage.word", "--halves", "\"" + printable(options.halves) + "\" is not known",
                          "Use scans or returns");
  }
  requireOneTool(options.map, std::string("evaluate ") + kPseudoTruth);
  if (!options.map.orientations.empty() || !options.map.rolls.empty()) {
    throw InvalidArgument("usage.orientations", options.map.orientations.empty() ? "--rolls" : "--orientations",
                          "recordings are judged with a level tool", "Omit it");
  }
  if (options.map.every < 1) throw InvalidArgument("usage.every", "--every", "must be 1 or more");
  (void)densitiesOf(options);
  (void)scanInputOptions(options.map);
  (void)fieldParams(options.map);
}

/// The recording's name in the table: the last part of its path that is one.
std::string shortName(const std::string& recording) {
  const std::filesystem::path path = std::filesystem::path(recording).lexically_normal();
  return printable((path.has_filename() ? path.filename() : path.parent_path().filename()).string());
}

void addRecording(const PseudoTruthOptions& options, std::size_t number, const ToolGeometry& tool,
                  const eval::Observer& observer, Messages& messages, eval::TableResults& results) {
  MapOptions map = options.map;
  map.scans = options.recordings[number];
  if (!options.poses.empty()) map.poses = options.poses[number];
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(map));
  sayAboutScans(scans, messages);
  if (options.halves == "scans" && scans.size() < 2) {
    throw UnusableInput("pseudo_truth.scans", printable(map.scans), "a single scan has no second half",
                        "Use --halves returns, or a recording of two or more scans");
  }
  eval::PseudoTruthRequest request;
  request.name = shortName(map.scans);
  request.scans = scans.size();
  request.read = [&scans](std::size_t scan) { return scans.read(scan); };
  request.params = fieldParams(map, scans.recordedRangeNoise_m());
  MapOptions product = map;  // the paper's profile knows of no noise
  product.profile = "product";
  request.range_noise_m = fieldParams(product, scans.recordedRangeNoise_m()).tsdf.range_noise_m;
  request.halves = options.halves == "returns" ? eval::HalvesBy::Returns : eval::HalvesBy::Scans;
  request.densities = densitiesOf(options);
  const std::vector<ToolSpec> tools = onlyTool(tool, request.params);
  requireShownTools(map, tools, request.params, largestShareHidden(tools, request.params), messages);
  const eval::PseudoTruthResult result = eval::pseudoTruth(request, tool, observer);
  sayAboutReading(scans, messages);
  results.device = result.device;
  const auto column = map.profile == "paper" ? eval::TableColumn::Paper : eval::TableColumn::Product;
  for (const eval::PseudoTruthRun& run : result.runs) {
    results.rows.push_back(eval::pseudoTruthRow(request.name, column, result.params.tsdf.voxel_size_m, run));
    const eval::TableRow& row = results.rows.back();
    messages.notice(request.name + ", " + numberText(run.density) + " of the sparse half: " +
                    std::to_string(row.figures.points()) + " of " + std::to_string(run.verdicts.size()) +
                    " points judged, precision " + numberText(row.figures.precision()) + ", recall " +
                    numberText(row.figures.recall()) + ", F1 " + numberText(row.figures.f1()));
  }
}

}  // namespace

bool wantsPseudoTruth(const Arguments& arguments) {
  return std::any_of(arguments.begin(), arguments.end(), [](const std::string& argument) {
    return argument == kPseudoTruth || argument.rfind(std::string(kPseudoTruth) + "=", 0) == 0;
  });
}

int runPseudoTruth(const Arguments& arguments, Messages& messages) {
  PseudoTruthOptions options;
  FlagParser flags(kLab);
  addPseudoTruthOptions(flags, options);
  // "--pseudo-truth --help" asks for help, although the flag takes a value.
  const bool help = std::find(arguments.begin(), arguments.end(), "--help") != arguments.end();
  if (!parseCommandLine(flags, help ? Arguments{"--help"} : arguments, options.map.common, messages)) return 0;
  checkPseudoTruthOptions(options);
  const std::filesystem::path out = options.map.out;
  const Paths outputs = inFolder(options.map.out, {"tables.json", "tables.md"});
  Paths inputs = {options.map.common.config};
  inputs.insert(inputs.end(), options.recordings.begin(), options.recordings.end());
  inputs.insert(inputs.end(), options.poses.begin(), options.poses.end());
  requireNoInputs(outputs, inputs);
  requireOwn(outputs);
  const ToolGeometry tool = loadTool(options.map.tool);
  sayToolNotes(tool, messages);
  requireClosedTools(options.map, onlyTool(tool, fieldParams(options.map)));
  watchStopSignals();

  eval::Observer observer;
  observer.say = [&messages](const std::string& line) { messages.notice(line); };
  observer.stop = [] { return stopSignal() != 0; };
  eval::TableResults results;
  const auto start = std::chrono::steady_clock::now();
  try {
    for (std::size_t n = 0; n < options.recordings.size(); ++n) {
      addRecording(options, n, tool, observer, messages, results);
    }
    results.finished = {"pseudo_truth"};
  } catch (const eval::StopRequested&) {
    results.stopped = true;
  } catch (...) {
    results.stopped = true;
    results.failure = std::current_exception();
  }
  results.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (!results.rows.empty()) {
    io::prepareOutputFolder(out);
    const eval::TableOrigin origin = {
        {"command", labCommandLine("evaluate", arguments)},
        {"version", ACCESSVDB_VERSION},
        {"machine", eval::machineInWords()},
        {"threads", options.map.common.threads > 0 ? std::to_string(options.map.common.threads) : "all"},
        {"device", results.device}};
    eval::writeTablesJson(out / "tables.json", results, origin);
    eval::writeTablesMarkdown(out / "tables.md", results, origin);
    messages.notice("done in " + numberText(results.seconds) + " s; wrote tables.json and tables.md into " +
                    out.string());
  }
  if (results.failure) std::rethrow_exception(results.failure);
  if (!results.stopped) return 0;
  messages.notice(std::string("stopped by ") + stopSignalName() +
                  (results.rows.empty() ? "; nothing to save" : "; finished recordings are saved"));
  return 128 + stopSignal();
}

}  // namespace accessvdb::tools
