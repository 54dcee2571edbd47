// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb advise: looks at scans and proposes the parameters to map them with, as a file for map --config.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <ostream>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/memory_prediction.h"
#include "options/map_options.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/run_summary.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/cloud_survey.h"
#include "runs/memory_check.h"
#include "runs/tile_job.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

/// Returns that are looked at; more scans are thinned evenly.
constexpr double kReturnsLookedAt = 2e7;
/// Returns around a point for a confidence of one half, which also makes a normal of the tool's scale.
constexpr double kReturnsWanted = 5;
constexpr double kShareWanted = 0.9;

struct Proposal {
  double voxel_m = 0, spacing_m = 0, share_seen = 0;
  double most_voxel_m = 0;  ///< for the tool
  bool voxel_by_noise = false;
  std::optional<PlaneNoise> measured;
  double range_noise_m = 0, tau_m = 0;
  double predicted_bytes = 0;
};

template <typename Use>
bool forScans(io::ScanSequence& scans, std::size_t stride, const char* what, Messages& messages, const Use& use) {
  Progress progress(messages, what, scans.size());
  for (std::size_t step = 0; step < scans.size(); step += stride) {
    if (stopSignal() != 0) return false;
    use(scans.read(step));
    progress.show(std::min(step + stride, scans.size()));
  }
  progress.finish();
  return true;
}

/// Two digits are all that is known, and all that one reads.
double rounded(double value) {
  if (!(value > 0)) return 0;
  const double scale = std::pow(10, std::floor(std::log10(value)) - 1);
  return std::round(value / scale) * scale;
}

std::size_t strideFor(io::ScanSequence& scans) {
  const io::ScanRecord first = scans.read(0);
  const double all =
      static_cast<double>(first.points_S.size() + first.points_W.size()) * static_cast<double>(scans.size());
  return static_cast<std::size_t>(std::max(1.0, std::ceil(all / kReturnsLookedAt)));
}

/// At larger voxels the tool itself would vanish. @throws UnusableInput "tool.hidden"  if it does at all
double mostVoxel_m(const MapOptions& options, const ToolGeometry& tool) {
  const double most_m = voxelThatShows_m(tool, fieldParams(options), std::end(kVoxels_m)[-1]);
  if (most_m > 0) return most_m;
  throw UnusableInput("tool.hidden", tool.name(),
                      "more than half of the tool is within 3 voxels of its tip at every voxel size, and collisions "
                      "there do not count",
                      "Check --tool-unit and --tool-tip");
}

/// @param most_voxel_m  for the tool
Proposal propose(const MapOptions& options, double most_voxel_m, const CloudSurvey& survey, std::size_t stride,
                 std::optional<double> recorded_noise_m) {
  Proposal proposal;
  proposal.most_voxel_m = most_voxel_m;
  proposal.spacing_m = survey.spacing_m();
  proposal.measured = survey.noise();
  proposal.range_noise_m = options.range_noise_m ? *options.range_noise_m
                           : proposal.measured   ? rounded(proposal.measured->sigma_m)
                           : recorded_noise_m    ? *recorded_noise_m
                                                 : TsdfParams{}.range_noise_m;
  for (const double voxel_m : kVoxels_m) {
    if (voxel_m > most_voxel_m) break;
    proposal.voxel_m = voxel_m;
    proposal.voxel_by_noise = voxel_m < proposal.range_noise_m;
    if (proposal.voxel_by_noise) continue;
    proposal.share_seen = survey.shareSeen(voxel_m, kReturnsWanted, static_cast<double>(stride));
    if (proposal.share_seen >= kShareWanted) break;
  }
  return proposal;
}

std::string percentText(double share) { return numberText(std::round(100 * share)) + " %"; }

std::string commented(const FlagParser& flags, const MapOptions& options, const Proposal& proposal,
                      const CloudSurvey& survey, std::size_t steps, std::size_t stride) {
  const auto metres = [](double value) { return numberText(rounded(value)) + " m"; };
  const Eigen::Vector3d size_m = survey.extent_W().sizes();
  std::string text = "# accessvdb advise: what to map these scans with. For map --config; flags win over it.\n";
  text += "# " + std::to_string(survey.returns()) + " returns of " + std::to_string((steps + stride - 1) / stride) +
          " of " + std::to_string(steps) + " steps; " + metres(size_m.x()) + " x " + metres(size_m.y()) + " x " +
          metres(size_m.z()) + "; median range " + metres(survey.medianRange_m()) + "\n\n[map]\n";
  for (const auto& [key, value] : flags.settings()) {
    const std::string* const given = std::get_if<std::string>(&value);
    const bool own = key == "voxel" || key == "range-noise" || key == "tau" || key == "tiles" || key == "out" ||
                     key == "max-memory" || key == "threads" || key == "device" || key == "host-fusion" ||
                     key == "max-device-memory";
    if (!flags.isSet(key) || own) continue;
    text += given != nullptr ? configEntry(key, *given) : configEntry(key, std::get<bool>(value) ? "true" : "false");
  }
  text += "\n# Points are " + metres(proposal.spacing_m) + " from their nearest neighbour; with these voxels " +
          percentText(proposal.share_seen) + " of them have " + numberText(kReturnsWanted) +
          " returns or more in the 27 voxels around.\n# No smaller than the range noise: below it, surfaces are rough "
          "and normals need many more points.\n# No larger than " +
          metres(proposal.most_voxel_m) + " either: more than half of the tool would vanish in its tip.\n" +
          configEntry("voxel", numberText(proposal.voxel_m));
  text += "\n# Standard deviation of the ranges, metres. ";
  if (options.range_noise_m) {
    text += "As given.\n";
  } else if (proposal.measured) {
    text += "Measured: " + std::to_string(proposal.measured->planes) + " flat pieces of " +
            metres(proposal.measured->plane_m) + " are " + metres(proposal.measured->sigma_m) +
            " thick along\n# the rays; errors of the poses are in it, so are surfaces that are not quite flat.\n";
  } else {
    text +=
        "Not measured: there are too few flat pieces with many points. This is\n# what was recorded next to the "
        "scans, else the default.\n";
  }
  text += configEntry("range-noise", numberText(proposal.range_noise_m));
  text += "\n# Truncation distance, metres: the larger of 4 voxels and 5 times the range noise.\n" +
          configEntry("tau", numberText(proposal.tau_m));
  const auto available = availableMemoryBytes();
  text += "\n# In one piece this takes " + std::string(stride > 1 ? "at least " : "about ") +
          bytesInWords(proposal.predicted_bytes) +
          (available ? "; this machine can give " + bytesInWords(static_cast<double>(*available)) : std::string()) +
          ".\n# auto maps in tiles where that does not fit, with the same results.\n" + configEntry("tiles", "auto");
  return text;
}

void checkAdviseOptions(const MapOptions& options) {
  checkCommonOptions(options.common);
  if (options.scans.empty())
    throw InvalidArgument("usage.missing", "--scans", "is missing", "Name a folder of scans or one file");
  if (options.every < 1) throw InvalidArgument("usage.every", "--every", "must be 1 or more");
  (void)scanInputOptions(options);
}

}  // namespace

int runAdvise(const Arguments& arguments, Messages& messages) {
  MapOptions options;
  options.tool.tool = "builtin:pruner";
  FlagParser flags;
  flags.describe("advise", "Looks at scans, and proposes voxel, range noise, tau and tiles as a file for map --config.",
                 "accessvdb advise --scans scans/ --poses poses.txt --out flight.toml\n"
                 "  accessvdb map --config flight.toml --tool builtin:pruner --out out/");
  addCommonOptions(flags, options.common);
  addScanFlags(flags, options);
  addMappingOptions(flags, options);
  flags.option("--out", &options.out, "file for the proposal; default: standard output");
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkAdviseOptions(options);
  requireOneTool(options, "advise");
  watchStopSignals();
  requireNoInputs({options.out}, namedInputs(options));

  const ToolGeometry tool = loadTool(options.tool);
  sayToolNotes(tool, messages);
  const double most_voxel_m = mostVoxel_m(options, tool);
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(options));
  requireNoInputs({options.out}, inputsWith(options, scans));
  sayAboutScans(scans, messages);
  static_cast<void>(checkAgreement(
      options, options.range_noise_m.value_or(scans.recordedRangeNoise_m().value_or(TsdfParams{}.range_noise_m)), scans,
      messages));
  const std::size_t stride = strideFor(scans);
  CloudSurvey survey;
  if (!forScans(scans, stride, "looking at scans", messages, [&](const io::ScanRecord& record) { survey.add(record); }))
    return 128 + stopSignal();
  if (survey.returns() == 0)
    throw UnusableInput("scans.no_returns", options.scans, "has no returns", "Check the scans");
  Proposal proposal = propose(options, most_voxel_m, survey, stride, scans.recordedRangeNoise_m());

  MapOptions proposed = options;
  proposed.voxel_m = proposal.voxel_m;
  proposed.range_noise_m = proposal.range_noise_m;
  const FieldParams params = fieldParams(proposed);
  proposal.tau_m = params.tsdf.truncation_distance_m;
  MemoryPredictor predictor(params.tsdf, rememberedDirections(onlyTool(tool, params), params));
  std::optional<Eigen::Vector3d> origin_W;
  const bool whole = forScans(scans, stride, "predicting memory", messages, [&](const io::ScanRecord& record) {
    const auto add = [&](const Eigen::Vector3d& sensor_W, const Eigen::Vector3d& p_W) {
      if (!sensor_W.allFinite() || !p_W.allFinite() || sensor_W == p_W) return;
      if (!origin_W) origin_W = sensor_W;
      predictor.add(sensor_W - *origin_W, p_W - *origin_W);
    };
    for (std::size_t i = 0; i < record.points_W.size(); ++i)
      add(record.origins_W.size() == 1 ? record.origins_W[0] : record.origins_W.at(i), record.points_W[i]);
    for (const Eigen::Vector3f& p_S : record.points_S)
      if (!p_S.isZero(0)) add(record.T_W_S.translation(), record.T_W_S * p_S.cast<double>());
  });
  if (!whole) return 128 + stopSignal();
  sayAboutReading(scans, messages);
  MemoryPrediction prediction = predictor.prediction();
  prediction.input_bytes = scans.heldBytes();
  proposal.predicted_bytes =
      peakBytes(prediction.bytes(RunOutput::Field), toolTableBytes(onlyTool(tool, params), params));

  const std::string text = commented(flags, options, proposal, survey, scans.size(), stride);
  if (options.out.empty()) {
    printData(text);
    return 0;
  }
  io::writeFileDurably(options.out, [&](std::ostream& out) { out << text; });
  messages.notice("wrote " + options.out + "; next: accessvdb map --config " + options.out + " --tool TOOL --out OUT");
  return 0;
}

}  // namespace accessvdb::tools
