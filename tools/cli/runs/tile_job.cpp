// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/tile_job.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "accessvdb/config.h"
#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/params_rows.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/tool_tables.h"
#include "options/tools_given.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "runs/agreement_check.h"
#include "runs/first_returns.h"
#include "runs/memory_check.h"
#include "runs/run_progress.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Flags that say where and how to run, not what to map.
constexpr const char* kNotOfThePlan[] = {"out",         "device",
                                         "threads",     "config",
                                         "quiet",       "error-format",
                                         "max-memory",  "tiles",
                                         "bin-memory",  "fresh",
                                         "help",        "keep-rays",
                                         "no-clobber",  "print-config",
                                         "checkpoint",  "checkpoint-every",
                                         "resume",      "append",
                                         "html",        "remove",
                                         "removed-as",  "allow-disagreement",
                                         "rolling",     "replay-log",
                                         "host-fusion", "max-device-memory"};
constexpr const char* kPaths[] = {"scans", "poses", "calib", "tool", "origin", "trajectory", "stations", "crs"};
/// Flags that change how the tool is read or what is written, beside the parameters of the field.
constexpr const char* kOfTheResult[] = {"tool-unit", "tool-tip",      "tool-axis", "tool-up", "half", "compression",
                                        "up-axis",   "points-format", "carry",     "index",   "crs"};
/// Flags that say what a flight's scans are.
constexpr const char* kOfAFlight[] = {
    "scans",       "poses",       "calib",    "pose-format", "sensor-at", "every",      "allow-truncated", "sort-poses",
    "trajectory",  "time-offset", "stations", "laz-command", "topic",     "pose-topic", "fixed-frame",     "extrinsic",
    "exclude-box", "level",       "ray",      "match",       "max-gap",   "keep-noise"};

constexpr std::uint64_t kMostBinBytes = std::uint64_t{1} << 30, kLeastBinBytes = std::uint64_t{32} << 20;
/// Of the process without any map, and of one step of scans.
constexpr std::uint64_t kProcessBytes = std::uint64_t{200} << 20;

template <std::size_t kCount>
bool isIn(const char* const (&list)[kCount], const std::string& key) {
  return std::any_of(std::begin(list), std::end(list), [&](const char* word) { return key == word; });
}

fs::path absolutePath(const fs::path& path) { return fs::absolute(path).lexically_normal(); }

/// The settings named in a list, files left out: those are compared by their content.
template <std::size_t kCount>
std::string textOf(const PlanSettings& settings, const char* const (&list)[kCount]) {
  std::string text;
  for (const auto& [key, value] : settings) {
    if (isIn(list, key) && !isIn(kPaths, key)) text += key + " " + valuesInWords(value) + "\n";
  }
  return text;
}

std::vector<tiles::PlannedInput> inputsOf(const PlanSources& sources) {
  std::vector<tiles::PlannedInput> inputs;
  std::set<std::string> known;
  const auto add = [&](const fs::path& given, bool small) {
    if (!io::isFile(given)) return;
    const fs::path path = absolutePath(given);  // the next step may run in another working directory
    if (!known.insert(path.string()).second) return;
    inputs.push_back({path.string(), fs::file_size(path), small ? io::sha256OfFile(path) : std::string()});
  };
  const SurveyOptions& survey = sources.options.survey;
  for (const fs::path path : {sources.options.poses, sources.options.calib, survey.trajectory, survey.stations}) {
    add(path, true);
  }
  for (const std::string& path : valuesOf(sources.options.tool.tool)) add(path, true);
  for (const std::string& path : sources.scans.paths()) add(path, false);
  return inputs;
}

}  // namespace

tiles::Flight flightOf(const PlanSources& sources, const PlanSettings& settings) {
  tiles::Flight flight;
  flight.options = textOf(settings, kOfAFlight);
  // What it does counts, not what was asked: other rays of the same files.
  if (sources.scans.deskews()) flight.options += "deskewed true\n";
  flight.inputs = inputsOf(sources);
  for (std::size_t step = 0; step < sources.scans.size(); ++step) {
    const double stamp_s = sources.scans.stamp_s(step).value_or(0);
    flight.stamps_s.push_back(std::isfinite(stamp_s) ? stamp_s : 0);
  }
  flight.settings = settings;
  return flight;
}

namespace {

/// The largest edge of tiles that is not above the wanted one.
std::int32_t edgeBelow(double wanted_m, const tiles::TileMargins& margins, double voxel_m) {
  const double least_m = margins.least_tile_voxels * voxel_m;
  // A length such as 6.4 at 0.05 m is meant as 128 voxels, whatever the last bit of the quotient says.
  const double wanted_voxels = wanted_m / voxel_m * (1 + 1e-9);
  if (wanted_voxels < margins.least_tile_voxels) {
    throw InvalidArgument("usage.tiles", "--tiles " + numberText(wanted_m),
                          "is less than twice the margin of " + numberText(margins.returns_voxels * voxel_m) +
                              " m that every tile needs on each side with this tool",
                          "Use --tiles " + numberText(least_m) + " or larger");
  }
  std::int32_t edge = margins.least_tile_voxels;
  while (edge < (1 << 16) && 2.0 * edge <= wanted_voxels) edge *= 2;
  return edge;
}

std::uint64_t binBytes(const MapOptions& options) {
  if (!options.bin_memory.empty()) return std::max(parseBytes("--bin-memory", options.bin_memory), kLeastBinBytes);
  const std::uint64_t limit = memoryLimit(options).value_or(4 * kMostBinBytes);
  const std::uint64_t rest = limit > kProcessBytes ? limit - kProcessBytes : 0;
  return std::clamp(rest / 2, kLeastBinBytes, kMostBinBytes);
}

tiles::Plan newPlan(const PlanSources& sources, std::int32_t chosen_voxels, Messages& messages) {
  const FieldParams& params = sources.params;
  const double voxel_m = params.tsdf.voxel_size_m;
  requireShownTools(sources.options, sources.tools, params, largestShareHidden(sources.tools, params), messages);
  const tiles::TileMargins margins = tiles::tileMargins(sources.tools, params, tableProgress(messages));
  tiles::Plan plan;
  plan.program = ACCESSVDB_VERSION;
  auto [words, flight] = plannedSources(sources);
  plan.parameters = describeTools(sources.tools, params) + words;
  plan.tool_name = sources.tools.size() == 1 ? sources.tools.front().tool.name() : namesOf(sources.tools);
  plan.tool_sha256 = toolListSha256(sources.tools);
  plan.origin_W = params.origin_W ? *params.origin_W : tiles::originOf(sources.scans, params);
  plan.voxel_size_m = voxel_m;
  plan.tile_voxels = chosen_voxels > 0 ? chosen_voxels : edgeBelow(wantedTile_m(sources.options), margins, voxel_m);
  plan.margin_voxels = margins.returns_voxels;
  plan.bin_bytes = binBytes(sources.options);
  plan.frame = sources.scans.frame();
  plan.flights.push_back(std::move(flight));
  messages.notice("tiles of " + std::to_string(plan.tile_voxels) + " voxels, " +
                  numberText(plan.tile_voxels * voxel_m) + " m, with a margin of " +
                  numberText(plan.margin_voxels * voxel_m) + " m for the tool");
  return plan;
}

}  // namespace

void removePieces(const fs::path& out) {
  std::error_code ignored;
  for (const fs::path& file : inFolder(out, {"field.vdb", "field_points.vdb", "points.ply", "points.las"})) {
    if (isOwn(file)) fs::remove(file, ignored);
  }
}

namespace {

/// With what scans or the verb have decided.
PlanSettings settled(PlanSettings settings, const FieldParams& params) {
  std::erase_if(settings,
                [](const auto& setting) { return setting.first == "range-noise" || setting.first == "origin"; });
  // What was recorded next to the scans is found again without them, and an origin without the earlier result.
  settings.emplace_back("range-noise", fullNumber(params.tsdf.range_noise_m));
  if (const auto& origin_W = params.origin_W) {
    settings.emplace_back(
        "origin", fullNumber((*origin_W)[0]) + "," + fullNumber((*origin_W)[1]) + "," + fullNumber((*origin_W)[2]));
  }
  return settings;
}

}  // namespace

std::pair<std::string, tiles::Flight> plannedSources(const PlanSources& sources) {
  const PlanSettings settings = settled(sources.settings, sources.params);
  return {textOf(settings, kOfTheResult), flightOf(sources, settings)};
}

std::pair<std::string, tiles::Flight> plannedLive(const PlanSettings& given, const FieldParams& params) {
  PlanSettings settings = settled(given, params);
  MapOptions ignored;
  FlagParser of_map;
  addMapFlags(of_map, ignored, "--out");
  std::erase_if(settings, [&](const auto& setting) {
    return !of_map.has(setting.first) || setting.first == "change" || setting.first == "free-for";
  });
  // The defaults of live are others.
  settings.emplace_back("change", kEnumWords<ChangeMode>[static_cast<std::size_t>(params.change.mode)]);
  if (std::isfinite(params.change.free_for_s)) settings.emplace_back("free-for", fullNumber(params.change.free_for_s));
  tiles::Flight flight;
  flight.options = textOf(settings, kOfAFlight);
  flight.settings = settings;
  return {textOf(settings, kOfTheResult), flight};
}

PlanSettings planSettings(const FlagParser& flags) {
  PlanSettings settings;
  for (const auto& [key, value] : flags.settings()) {
    if (isIn(kNotOfThePlan, key)) continue;
    const bool* on = std::get_if<bool>(&value);
    std::string text = on != nullptr ? (*on ? "true" : "false") : std::get<std::string>(value);
    if (text.empty() || text == "false") continue;
    // Later than the first plans, which do not have them.
    if ((key == "points" && text == "all") || (key == "point-spacing" && text == "auto")) continue;
    if ((key == "match" && text == "auto") || (key == "max-gap" && text == numberText(SurveyOptions().max_gap_s)))
      continue;
    std::string absolute;
    const std::vector<std::string> values = valuesOf(text);
    for (std::size_t n = 0; n < values.size(); ++n) {
      std::string each = values[n];
      if (isIn(kPaths, key) && io::isThere(each)) each = absolutePath(each).string();
      constexpr std::string_view kList = "list:";
      if (key == "orientations" && each.starts_with(kList) && each.size() > kList.size()) {
        each = std::string(kList) + absolutePath(each.substr(kList.size())).string();
      }
      absolute.append(n == 0 ? 0 : 1, kBetweenValues).append(each);
    }
    settings.emplace_back(key, absolute);
  }
  return settings;
}

std::optional<std::string> whyNotInTiles(const MapOptions& options, const FieldParams& params) {
  if (options.exported.surface) return "--surface needs all points at once";
  if (options.exported.sequence > 0) return "--sequence needs the whole map after each scan";
  if (!options.remove.empty()) return "--remove needs a map in one piece";
  if (!options.replay_log.empty()) return "--replay-log needs a map in one piece";
  if (!options.checkpoint.empty() || !options.resume.empty()) {
    return "finished tiles are kept without --checkpoint, and the same command goes on with the others";
  }
  if (params.update.policy == UpdatePolicy::Paper) return "the paper's policy gives other labels in tiles";
  if (params.tsdf.clear_rays_m > 0 || params.tsdf.platform_radius_m > 0)
    return "--clear-rays and --platform-radius reach farther than what tiles share";
  return std::nullopt;
}

tiles::Plan planOf(const PlanSources& sources, std::int32_t chosen_voxels, Messages& messages) {
  const fs::path out = sources.options.out;
  if (sources.options.fresh || !tiles::hasPlan(out)) {
    tiles::requireOwnFolders(out);
    const tiles::Plan plan = identified(newPlan(sources, chosen_voxels, messages));
    if (sources.options.fresh) tiles::removePlan(out);  // only now: nothing is deleted for what is refused
    if (!sources.options.no_clobber) removePieces(out);
    tiles::writePlan(out, plan);
    return plan;
  }
  const tiles::Plan found = tiles::readPlan(out);
  const bool sized = wantedTile_m(sources.options) > 0;
  tiles::Plan wanted = newPlan(sources, sized ? 0 : found.tile_voxels, messages);
  wanted.bin_bytes = found.bin_bytes;
  tiles::requireSame(identified(std::move(wanted)), found, out);
  messages.notice("going on with the tiles of an earlier run in " + out.string());
  return found;
}

namespace {

/// Options as the plan's settings say.
MapOptions optionsFrom(const fs::path& out, const PlanSettings& settings) {
  MapOptions options;
  FlagParser flags;
  addMapFlags(flags, options, "--out");
  for (const auto& [key, value] : settings) {
    if (flags.has(key) && !flags.set(key, value)) continue;
    throw InputError("plan.damaged", (out / "plan.json").string(), "has a setting that is not known: " + key,
                     "Start again with --fresh");
  }
  return options;
}

/// All flights carry what the plan says, and are in its coordinate system.
void readAsPlanned(const MapOptions& planned, MapOptions& flight) {
  flight.survey.carry = planned.survey.carry;
  flight.survey.index = planned.survey.index;
  flight.survey.crs = planned.survey.crs;
  flight.exported.points_format = planned.exported.points_format;
}

}  // namespace

OpenJob openJob(const fs::path& out, const MapOptions& options) {
  tiles::Plan plan = tiles::readPlan(out);
  const PlanSettings& settings = plan.flights.front().settings;
  MapOptions planned = optionsFrom(out, settings);
  planned.common = options.common;
  planned.max_memory = options.max_memory;
  planned.out = out.string();
  std::vector<MapOptions> flights;
  for (const tiles::Flight& flight : plan.flights) {
    flights.push_back(optionsFrom(out, flight.settings));
    readAsPlanned(planned, flights.back());
  }
  std::vector<ToolSpec> specs = loadTools(planned);
  FieldParams params = fieldParams(planned);
  const auto changed = [&](const std::string& what) {
    throw UnusableInput("plan.changed", out.string(), what,
                        "Use what the plan was made with, or start again with --fresh");
  };
  if (plan.program != ACCESSVDB_VERSION) changed("was planned by version " + plan.program + " of accessvdb");
  if (toolListSha256(specs) != plan.tool_sha256) {
    changed("was planned with another tool than " + valuesInWords(planned.tool.tool) + " is now");
  }
  if (plan.parameters != describeTools(specs, params) + textOf(settings, kOfTheResult)) {
    changed("was planned with other parameters");
  }
  addFirstReturns(plan.frame, params);
  params.mirror_distance = false;  // only for kernels of a live map; takes memory that the prediction does not count
  tiles::Job job = {out, std::move(plan), specs, std::move(params)};
  return {std::move(planned), std::move(flights), std::move(specs), std::move(job)};
}

MapOptions flightOptions(const OpenJob& open, const PlanSettings& settings) {
  MapOptions options = optionsFrom(open.job.out, settings);
  readAsPlanned(open.options, options);
  return options;
}

io::ScanInputOptions inputOfFlight(const OpenJob& open, std::size_t flight) {
  io::ScanInputOptions input = scanInputOptions(open.flights[flight]);
  const std::string& poses = open.job.plan.flights[flight].poses_in_effect;
  if (poses.empty()) return input;
  // Each scan that counts has its pose there, as the sensor's, whatever made it: nothing is added to it or
  // interpolated.
  const io::ScanInputOptions plain;
  input.poses = open.job.out / poses;
  input.pose_format = plain.pose_format;
  input.match = plain.match;
  input.max_gap_s = 1e-3;
  input.calib = plain.calib;
  input.sort_poses = plain.sort_poses;
  input.T_B_S = plain.T_B_S;
  input.level = plain.level;
  input.pose_topic = plain.pose_topic;
  input.every = plain.every;
  input.deskew = io::Deskew::Off;
  return input;
}

void requirePlannedPoses(const OpenJob& open, std::size_t flight) {
  const bool full = open.job.params.change.mode == ChangeMode::Full;
  const auto require = [full](const fs::path& file, const std::string& sha256) {
    if (sha256.empty() || io::sha256OfFile(file) == sha256) return;
    throw UnusableInput("plan.changed", file.string(), "has changed since the plan was made",
                        full ? "Restore it, or make a plan in another folder"
                             : "Restore it; with corrected poses, accessvdb tile plan OUT --poses FILE goes on");
  };
  const tiles::Flight& planned = open.job.plan.flights[flight];
  for (const tiles::PlannedInput& input : planned.inputs) require(input.path, input.sha256);
  if (!planned.poses_in_effect.empty()) {
    require(open.job.out / planned.poses_in_effect, planned.poses_in_effect_sha256);
  }
}

void appendFlight(const fs::path& out, const MapOptions& options, const FlagParser& flags, Messages& messages) {
  OpenJob open = openJob(out, options);
  PlanSettings settings = planSettings(flags);
  for (const auto& [key, value] : settings) {
    if (isIn(kOfAFlight, key) || key == "deskew" || !flags.isSet(key)) continue;
    throw InvalidArgument("usage.append", "--" + key, "belongs to the plan that the flight is added to",
                          "Give the scans of the flight only");
  }
  std::erase_if(settings,
                [](const auto& setting) { return !isIn(kOfAFlight, setting.first) && setting.first != "deskew"; });
  MapOptions of_flight = options;
  readAsPlanned(open.options, of_flight);
  io::ScanSequence scans = io::ScanSequence::open(scanInputOptions(of_flight));
  sayAboutScans(scans, messages);
  const std::string planned = open.job.plan.frame.systemSha256(), added = scans.frame().systemSha256();
  if (!planned.empty() && !added.empty() && planned != added) {
    throw UnusableInput("scans.frame", options.scans, "says another coordinate system than the plan's scans",
                        "Reproject it, or plan all flights with --crs");
  }
  static_cast<void>(checkAgreement(options, open.job.params.tsdf.range_noise_m, scans, messages));
  const PlanSources sources = {options, settings, open.tools, scans, open.job.params};
  tiles::Plan& plan = open.job.plan;
  plan.flights.push_back(flightOf(sources, settings));
  tiles::writePlan(out, identified(plan));
  messages.notice("the plan has " + std::to_string(plan.flights.size()) + " flights now; next: accessvdb tile bin " +
                  out.string());
}

OpenScans::OpenScans(const OpenJob& open, Messages& messages) {
  for (std::size_t n = 0; n < open.flights.size(); ++n) {
    requirePlannedPoses(open, n);
    scans_.push_back(io::ScanSequence::open(inputOfFlight(open, n)));
    sayAboutScans(scans_.back(), messages);
    const std::size_t planned = open.job.plan.flights[n].stamps_s.size();
    if (scans_.back().size() == planned) continue;
    throw UnusableInput("plan.changed", open.flights[n].scans,
                        "has " + std::to_string(scans_.back().size()) + " steps instead of " + std::to_string(planned),
                        "Restore the scans, or start again with --fresh");
  }
  for (io::ScanSequence& scans : scans_) pointers_.push_back(&scans);
}

}  // namespace accessvdb::tools
