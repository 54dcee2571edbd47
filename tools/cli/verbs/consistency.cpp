// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb consistency: recorded scans, for which there is no ground truth, judged by themselves.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <locale>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/tool_tables.h"
#include "options/map_options.h"
#include "options/tools_given.h"
#include "output/json_text.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/stop_signal.h"
#include "runs/label_agreement.h"
#include "runs/memory_check.h"
#include "verbs/verbs.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// `accessvdb evaluate --consistency` is the spelling of earlier versions.
constexpr const char* kOldVerb = "evaluate";
constexpr const char* kOldFlag = "--consistency";

/// The flags of `map` that say what is mapped and how; the others do not apply here.
void addConsistencyOptions(FlagParser& flags, const std::string& verb, MapOptions& options, bool& consistency) {
  const std::string spelling = verb == kOldVerb ? verb + " " + kOldFlag : verb;
  flags.describe(
      spelling, "Compares labels from half of the scans with those from the other half and from all scans.",
      "accessvdb " + spelling + " --scans scans/ --poses poses.txt --tool builtin:pruner --voxel 0.05 --out out/");
  addCommonOptions(flags, options.common);
  if (verb == kOldVerb) flags.flag(kOldFlag, consistency, "compare recorded scans with themselves");
  flags.option("--scans", &options.scans, "folder of .pcd, .ply, .bin, .las or .laz scans, or one ray cloud");
  flags.option("--poses", &options.poses,
               "pose file; may be omitted for VIEWPOINT poses, ray clouds, --trajectory and --stations");
  addMappingOptions(flags, options);
  flags.option("--out", &options.out, "folder for consistency.json and consistency.md");
}

double round2(double percent) { return std::round(percent * 100) / 100; }

double accessibleShare(const ConsistencyPart& part) {
  const auto accessible = static_cast<double>(part.labels[static_cast<std::size_t>(PointLabel::Accessible)]);
  const double scored = accessible + static_cast<double>(part.labels[static_cast<std::size_t>(PointLabel::Blocked)]);
  return scored > 0 ? 100 * accessible / scored : 0;
}

Json jsonOf(const ConsistencyPart& part) {
  Json labels = Json::object(), reasons = Json::object();
  for (int i = 0; i < kNumPointLabels; ++i)
    labels[name(static_cast<PointLabel>(i))] = part.labels[static_cast<std::size_t>(i)];
  for (int i = 1; i < kNumPointReasons; ++i) {
    const std::uint64_t count = part.reasons[static_cast<std::size_t>(i)];
    if (i < static_cast<int>(PointReason::Changed) || count > 0) reasons[name(static_cast<PointReason>(i))] = count;
  }
  return {{"scans", part.scans},
          {"points_in", part.points_in},
          {"points_used", part.points_used},
          {"labels", labels},
          {"reasons", reasons},
          {"accessible_percent_of_scored", round2(accessibleShare(part))},
          {"seconds", round2(part.seconds)}};
}

Json jsonOf(const char* first, const char* second, const LabelAgreement& agreement) {
  Json matrix = Json::object();
  for (int i = 0; i < kNumPointLabels; ++i) {
    for (int j = 0; j < kNumPointLabels; ++j) {
      matrix[name(static_cast<PointLabel>(i))][name(static_cast<PointLabel>(j))] =
          agreement.voxels[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)];
    }
  }
  const auto kappa = agreement.kappa();
  return {{"first", first},
          {"second", second},
          {"voxels", matrix},
          {"only_first", agreement.only_first},
          {"only_second", agreement.only_second},
          {"compared", agreement.compared()},
          {"not_compared", agreement.notCompared()},
          {"agreement_percent", round2(agreement.agreementPercent())},
          {"kappa", kappa ? Json(std::round(*kappa * 10000) / 10000) : Json(nullptr)},
          {"accessible_percent_of_first", round2(agreement.accessiblePercentOfFirst())},
          {"accessible_percent_of_second", round2(agreement.accessiblePercentOfSecond())},
          {"precision", round2(agreement.precisionPercent())},
          {"recall", round2(agreement.recallPercent())}};
}

std::string fixed(double value, int digits) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text.setf(std::ios::fixed);
  text.precision(digits);
  text << value;
  return text.str();
}
std::string kappaText(const LabelAgreement& agreement) {
  const auto kappa = agreement.kappa();
  return kappa ? fixed(*kappa, 3) : "-";
}

void putPair(std::ostream& out, const char* first, const char* second, const LabelAgreement& a) {
  out << "\n## " << first << " against " << second << "\n\n| " << first << " \\ " << second
      << " | accessible | blocked | unscored |\n|---|---|---|---|\n";
  for (const PointLabel row : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) {
    out << "| " << name(row);
    for (const PointLabel column : {PointLabel::Accessible, PointLabel::Blocked, PointLabel::Unscored}) {
      out << " | " << a.voxels[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)];
    }
    out << " |\n";
  }
  out << "\nIn " << first << " alone " << a.only_first << " voxels, in " << second << " alone " << a.only_second
      << ".\n";
}

void writeMarkdown(const fs::path& path, const ConsistencyResult& result, const MapOptions& options,
                   const FieldParams& params, const std::string& command) {
  io::writeFileDurably(path, [&](std::ostream& out) {
    out << "# Consistency of labels from recorded scans\n\n`" << command
        << "`, AccessVDB " ACCESSVDB_VERSION ", profile " << options.profile << ", voxel "
        << numberText(params.tsdf.voxel_size_m) << " m, tau " << numberText(params.tsdf.truncation_distance_m)
        << " m.\n\n"
        << "There is no ground truth for these scans. Voxels that hold a scored surface point in both maps are "
           "compared; "
           "precision and recall judge the first by the second.\n\n"
        << "| map | scans | returns used | surface points | accessible | blocked | unscored | accessible of scored, % "
           "|\n"
           "|---|---|---|---|---|---|---|---|\n";
    for (const auto& [title, part] : {std::pair{"even scans", &result.even}, std::pair{"odd scans", &result.odd},
                                      std::pair{"all scans", &result.all}}) {
      const auto& l = part->labels;
      out << "| " << title << " | " << part->scans << " | " << part->points_used << " | " << l[0] + l[1] + l[2] << " | "
          << l[static_cast<std::size_t>(PointLabel::Accessible)] << " | "
          << l[static_cast<std::size_t>(PointLabel::Blocked)] << " | "
          << l[static_cast<std::size_t>(PointLabel::Unscored)] << " | " << fixed(accessibleShare(*part), 1) << " |\n";
    }
    out << "\n| first | second | compared | agreement, % | kappa | accessible in first, % | in second, % | precision, "
           "% | "
           "recall, % |\n|---|---|---|---|---|---|---|---|---|\n";
    const std::array<std::tuple<const char*, const char*, const LabelAgreement*>, 3> pairs = {
        {{"even scans", "odd scans", &result.even_odd},
         {"even scans", "all scans", &result.even_all},
         {"odd scans", "all scans", &result.odd_all}}};
    for (const auto& [first, second, a] : pairs) {
      out << "| " << first << " | " << second << " | " << a->compared() << " | " << fixed(a->agreementPercent(), 1)
          << " | " << kappaText(*a) << " | " << fixed(a->accessiblePercentOfFirst(), 1) << " | "
          << fixed(a->accessiblePercentOfSecond(), 1) << " | " << fixed(a->precisionPercent(), 1) << " | "
          << fixed(a->recallPercent(), 1) << " |\n";
    }
    for (const auto& [first, second, a] : pairs) putPair(out, first, second, *a);
  });
}

void writeJson(const fs::path& path, const ConsistencyResult& result, const FieldParams& params,
               const std::string& command) {
  Json parameters = Json::object();
  std::istringstream lines(params.describe());
  for (std::string line; std::getline(lines, line);) {
    const auto blank = line.find(' ');
    parameters[line.substr(0, blank)] = line.substr(blank + 1);
  }
  const Json json = {
      {"schema", 1},
      {"version", ACCESSVDB_VERSION},
      {"command", command},
      {"parameters", parameters},
      {"maps", {{"even", jsonOf(result.even)}, {"odd", jsonOf(result.odd)}, {"all", jsonOf(result.all)}}},
      {"comparisons", Json::array({jsonOf("even", "odd", result.even_odd), jsonOf("even", "all", result.even_all),
                                   jsonOf("odd", "all", result.odd_all)})}};
  // Paths are bytes and need not be UTF-8.
  const std::string text = jsonText(json, 2) + "\n";
  io::writeFileDurably(path, [&](std::ostream& out) { out << text; });
}

void checkOptions(const MapOptions& options, const std::string& verb) {
  checkCommonOptions(options.common);
  for (const auto& [flag, value, what] :
       {std::tuple{"--scans", options.scans, "a folder of scans"},
        std::tuple{"--tool", options.tool.tool, "a mesh, builtin:pencil or builtin:pruner"},
        std::tuple{"--out", options.out, "the folder for the results"}}) {
    if (value.empty()) throw InvalidArgument("usage.missing", flag, "is missing", std::string("Name ") + what);
  }
  requireOneTool(options, verb);
  if (options.every < 1) throw InvalidArgument("usage.every", "--every", "must be 1 or more");
  (void)scanInputOptions(options);
  (void)fieldParams(options);
}

int stoppedBeforeResults(Messages& messages) {
  messages.notice(std::string("stopped by ") + stopSignalName() + "; nothing to save");
  return 128 + stopSignal();
}

/// Maps half of the scans, the other half and all, and writes consistency.json and consistency.md into --out.
int compareParts(const std::string& verb, const Arguments& arguments, Messages& messages) {
  MapOptions options;
  bool consistency = false;
  FlagParser flags;
  addConsistencyOptions(flags, verb, options, consistency);
  if (!parseCommandLine(flags, arguments, options.common, messages)) return 0;
  checkOptions(options, verb);
  const Paths outputs = inFolder(options.out, {"consistency.json", "consistency.md"});
  requireNoInputs(outputs, namedInputs(options));
  watchStopSignals();

  const ToolGeometry tool = loadTool(options.tool);
  sayToolNotes(tool, messages);
  sayOrientationNotes(options, messages);
  messages.notice(toolInWords(tool, options.tool));
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(options));
  requireNoInputs(outputs, inputsWith(options, scans));
  requireOwn(outputs);
  io::prepareOutputFolder(options.out);
  sayAboutScans(scans, messages);
  FieldParams params = fieldParams(options, scans.recordedRangeNoise_m());
  params.approach.rolls = rollsOf(tool, params.approach);
  // The three maps are made one at a time; the last, of all scans, needs the most.
  if (!checkMemory(options, onlyTool(tool, params), RunOutput::Labels, scans, {}, messages))
    return stoppedBeforeResults(messages);

  std::optional<Progress> progress;
  ConsistencyHooks hooks;
  hooks.stop = [] { return stopSignal() != 0; };
  hooks.progress = [&](const std::string& part, std::size_t done, std::size_t total) {
    if (done == 1) progress.emplace(messages, part, total);
    progress->show(done);
    if (done == total) progress->finish();
  };
  const auto result = measureConsistency(scans, tool, params, hooks);
  progress.reset();
  if (!result) return stoppedBeforeResults(messages);
  sayAboutReading(scans, messages);
  std::string command = "accessvdb " + verb;
  for (const std::string& argument : arguments) command += " " + argument;
  writeJson(fs::path(options.out) / "consistency.json", *result, params, printable(command));
  writeMarkdown(fs::path(options.out) / "consistency.md", *result, options, params, printable(command));
  for (const auto& [title, agreement] :
       {std::pair{"even against odd scans", &result->even_odd}, std::pair{"even against all scans", &result->even_all},
        std::pair{"odd against all scans", &result->odd_all}}) {
    messages.notice(std::string(title) + ": " + std::to_string(agreement->compared()) + " voxels compared (" +
                    std::to_string(agreement->notCompared()) + " not: in one of the two only, or unscored), " +
                    fixed(agreement->agreementPercent(), 1) + " % agree, kappa " + kappaText(*agreement) +
                    ", accessible " + fixed(agreement->accessiblePercentOfFirst(), 1) + " and " +
                    fixed(agreement->accessiblePercentOfSecond(), 1) + " %");
  }
  messages.notice("wrote consistency.json and consistency.md into " + options.out);
  return 0;
}

}  // namespace

int runConsistency(const Arguments& arguments, Messages& messages) {
  return compareParts("consistency", arguments, messages);
}

int runEvaluateConsistency(const Arguments& arguments, Messages& messages) {
  return compareParts(kOldVerb, arguments, messages);
}

bool wantsConsistency(const Arguments& arguments) {
  return std::find(arguments.begin(), arguments.end(), kOldFlag) != arguments.end();
}

}  // namespace accessvdb::tools
