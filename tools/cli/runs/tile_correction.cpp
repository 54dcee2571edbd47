// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "runs/tile_correction.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "options/options.h"
#include "output/output_files.h"
#include "output/progress.h"
#include "output/stop_signal.h"
#include "runs/agreement_check.h"
#include "runs/run_progress.h"
#include "runs/tile_job.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

/// Flags that say what the new poses are. All others are as planned; how the file of the poses is laid out is not.
constexpr const char* kOfPoses[] = {"poses", "trajectory", "stations",    "calib",  "pose-format",
                                    "match", "sort-poses", "time-offset", "max-gap"};
/// Stamps that differ by no more are the same, written with fewer digits.
constexpr double kSameTime_s = 1e-3;
/// A correction that is larger than this, and than the way of the sensor is long, is none.
constexpr double kFar_m = 10;

bool isOfPoses(const std::string& key) {
  return std::any_of(std::begin(kOfPoses), std::end(kOfPoses), [&](const char* word) { return key == word; });
}

fs::path wholePath(const fs::path& given) {
  const fs::path path = fs::absolute(given).lexically_normal();
  return path.has_filename() ? path : path.parent_path();
}

std::size_t flightNamed(const tiles::Plan& plan, const OpenJob& open, const std::string& scans) {
  if (scans.empty() && plan.flights.size() == 1) return 0;
  for (std::size_t n = 0; n < plan.flights.size(); ++n) {
    if (!scans.empty() && wholePath(scans) == wholePath(open.flights[n].scans)) return n;
  }
  throw InvalidArgument("usage.poses", scans.empty() ? "--scans" : scans,
                        scans.empty() ? "is missing: the plan has " + std::to_string(plan.flights.size()) + " flights"
                                      : "are the scans of no flight of the plan",
                        "Name the scans of the flight whose poses were corrected, as when it was planned");
}

PlanSettings correctedSettings(PlanSettings settings, const FlagParser& flags) {
  const auto refuse = [](const std::string& key) {
    throw InvalidArgument("usage.poses", "--" + key, "belongs to the plan whose poses are corrected",
                          "Give the new poses only, or make a plan in another folder");
  };
  for (const char* key : {"tiles", "bin-memory", "fresh"}) {
    if (flags.isSet(key)) refuse(key);
  }
  for (const auto& [key, value] : planSettings(flags)) {
    if (key == "scans" || !flags.isSet(key)) continue;
    if (!isOfPoses(key)) refuse(key);
    std::erase_if(settings, [&key = key](const auto& setting) { return setting.first == key; });
    settings.emplace_back(key, value);
  }
  if (!flags.isSet("pose-format")) {  // another file may be another format
    std::erase_if(settings, [](const auto& setting) { return setting.first == "pose-format"; });
  }
  return settings;
}

/// Scans of the flight with its poses so far; nothing where those are not what they were.
std::optional<io::ScanSequence> scansBefore(const OpenJob& open, std::size_t flight) {
  try {
    requirePlannedPoses(open, flight);
    return io::ScanSequence::open(inputOfFlight(open, flight));
  } catch (const Error&) {  // a file of poses that was overwritten, or is gone
    return std::nullopt;
  }
}

[[noreturn]] void refuseOther(const std::string& subject, const std::string& problem) {
  throw UnusableInput("poses.other_scans", subject, problem,
                      "Use poses of the same scans, or map them in another folder");
}

/// The new poses place the same scans, no others, in the same order.
void requireSameScans(const io::ScanSequence& now, const std::optional<io::ScanSequence>& before,
                      const tiles::Flight& planned, const std::string& subject) {
  if (now.size() != planned.stamps_s.size()) {
    refuseOther(subject, "places " + std::to_string(now.size()) + " scans, and the map is made of " +
                             std::to_string(planned.stamps_s.size()));
  }
  std::set<std::string> files;
  for (const tiles::PlannedInput& input : planned.inputs) files.insert(input.path);
  for (std::size_t step = 0; step < now.size(); ++step) {
    const std::string path = now.path(step);
    const bool other = before && before->size() == now.size() && before->path(step) != path;
    if (other || !files.contains(fs::absolute(path).lexically_normal().string())) {
      refuseOther(subject, "places other scans than the map is made of: " + path);
    }
    const double then_s = planned.stamps_s[step], now_s = now.stamp_s(step).value_or(0);
    if (then_s != 0 && now_s != 0 && !(std::abs(now_s - then_s) <= kSameTime_s)) {
      refuseOther(subject, "has scan " + std::to_string(step + 1) + " at " + fullNumber(now_s) +
                               " s, and the map is made of one at " + fullNumber(then_s) + " s");
    }
  }
}

/// One pose of each scan, before and after.
struct PosePair {
  Eigen::Isometry3d before, now;
};

/// Nothing where scans have no poses, or those of before are not known.
std::vector<PosePair> posePairs(const io::ScanSequence& now, const std::optional<io::ScanSequence>& before) {
  if (!before || before->size() != now.size()) return {};
  std::vector<PosePair> pairs;
  for (std::size_t step = 0; step < now.size(); ++step) {
    const auto from = before->sensorPose(step), to = now.sensorPose(step);
    if (!from || !to) return {};
    pairs.push_back({*from, *to});
  }
  return pairs;
}

void requireNear(const std::vector<PosePair>& pairs, const std::string& subject) {
  Eigen::AlignedBox3d way;
  for (const PosePair& pair : pairs) way.extend(pair.before.translation());
  const double most_m = pairs.empty() ? 0 : std::max(kFar_m, way.diagonal().norm());
  for (std::size_t step = 0; step < pairs.size(); ++step) {
    const double moved_m = (pairs[step].now.translation() - pairs[step].before.translation()).norm();
    if (moved_m <= most_m) continue;
    throw UnusableInput("poses.far", subject,
                        "moves scan " + std::to_string(step + 1) + " by " + numberText(moved_m) +
                            " m, and all scans lie within " + numberText(way.diagonal().norm()) + " m",
                        "Check its frame and its unit; poses in another frame need another folder");
  }
}

/// How far the sensor, or one of the returns that count, is from where it was.
double farthestMove_m(const io::ScanRecord& scan, const PosePair& pair, const TsdfParams& params) {
  const Eigen::Matrix3d turn = pair.now.linear() - pair.before.linear();
  const Eigen::Vector3d shift = pair.now.translation() - pair.before.translation();
  double farthest_m = shift.norm();
  for (const Eigen::Vector3f& p : scan.points_S) {
    const Eigen::Vector3d p_S = p.cast<double>();
    const double range_m = p_S.norm();
    if (!(range_m > 0 && range_m >= params.min_range_m && range_m <= params.max_range_m)) continue;
    farthest_m = std::max(farthest_m, (turn * p_S + shift).norm());
  }
  return farthest_m;
}

/// Of each scan of the flight; nothing where its rays were never sorted.
std::vector<double> longestRays_m(const OpenJob& open, std::size_t flight) {
  const auto rays = tiles::binned(open.job.out, open.job.plan);
  if (!rays || rays->farthest_m.size() != open.job.plan.steps()) return {};
  auto begin = rays->farthest_m.begin();
  for (std::size_t n = 0; n < flight; ++n) begin += std::ssize(open.job.plan.flights[n].stamps_s);
  return {begin, begin + std::ssize(open.job.plan.flights[flight].stamps_s)};
}

struct Moves {
  std::vector<bool> moved;  ///< of each scan: more than half a voxel
  std::size_t count = 0;
  double most_m = 0;  ///< of the sensors
  bool stopped = false;
};

/// @param farthest_m  of each scan, or nothing: no return is farther from the sensor
Moves movesOf(io::ScanSequence& now, const std::vector<PosePair>& pairs, const std::vector<double>& farthest_m,
              const TsdfParams& params, const Messages& messages) {
  Moves moves;
  const double enough_m = params.voxel_size_m / 2;
  Progress progress(messages, "comparing poses", pairs.size(), ShowShort::No);
  for (std::size_t step = 0; step < pairs.size() && !moves.stopped; ++step) {
    const PosePair& pair = pairs[step];
    const double shift_m = (pair.now.translation() - pair.before.translation()).norm();
    // Whether the far end of a ray moves is seen in the scan; there is seldom a need to look.
    bool moved = shift_m > enough_m;
    if (!moved && pair.now.matrix() != pair.before.matrix()) {
      // Of two rotations, the norm is the square root of 2 times as much as any vector turns.
      const double turn = (pair.now.linear() - pair.before.linear()).norm() / std::numbers::sqrt2;
      const double range_m = farthest_m.size() == pairs.size() ? farthest_m[step] : params.max_range_m;
      const double most_m = shift_m + (turn > 0 ? turn * range_m * (1 + 1e-9) : 0);
      moved = !(most_m <= enough_m) && farthestMove_m(now.read(step), pair, params) > enough_m;
    }
    moves.moved.push_back(moved);
    moves.count += moved ? 1 : 0;
    moves.most_m = std::max(moves.most_m, shift_m);
    progress.show(step + 1);
    moves.stopped = stopSignal() != 0;
  }
  return moves;
}

/// Writes the poses in effect, and looks whether they are read back as they are.
/// @return the flight with them; nothing where no pose file can hold them
std::optional<tiles::Flight> inEffect(const OpenJob& open, std::size_t flight, const PlanSources& sources,
                                      const std::vector<PosePair>& pairs, const Moves& moves) {
  const io::ScanSequence& scans = sources.scans;
  std::vector<tiles::ScanPose> poses;
  for (std::size_t step = 0; step < pairs.size(); ++step) {
    const bool recorded = step > 0 && scans.path(step) == scans.path(step - 1);
    poses.push_back({recorded ? std::string() : fs::path(scans.path(step)).filename().string(), scans.stamp_s(step),
                     moves.moved[step] ? pairs[step].now : pairs[step].before});
  }
  const std::string name = tiles::writePosesInEffect(open.job.out, poses);
  if (name.empty()) return std::nullopt;
  const fs::path file = open.job.out / name;
  OpenJob with = {open.options, open.flights, open.tools, open.job};
  with.job.plan.flights[flight].poses_in_effect = name;
  std::optional<io::ScanSequence> read;
  try {
    read = io::ScanSequence::open(inputOfFlight(with, flight));
  } catch (const Error&) {  // names that mean something else to a pose file
  }
  bool same = read && read->size() == poses.size();
  for (std::size_t step = 0; step < poses.size() && same; ++step) {
    const auto pose = read->sensorPose(step);
    same = pose && pose->matrix() == poses[step].T_W_S.matrix() && read->path(step) == scans.path(step);
  }
  if (!same) {
    fs::remove(file);
    return std::nullopt;
  }
  // The user's file of poses is not needed from here on.
  MapOptions unposed = sources.options;
  unposed.poses.clear();
  unposed.calib.clear();
  tiles::Flight result = flightOf({unposed, sources.settings, sources.tools, *read, sources.params}, sources.settings);
  std::erase_if(result.inputs, [whole = wholePath(file)](const auto& input) { return fs::path(input.path) == whole; });
  result.poses_in_effect = name;
  result.poses_in_effect_sha256 = io::sha256OfFile(file);
  return result;
}

}  // namespace

bool givesPosesAlone(const MapOptions& options) {
  const bool poses = !options.poses.empty() || !options.survey.trajectory.empty() || !options.survey.stations.empty();
  return poses && options.tool.tool.empty() && (options.scans.empty() || tiles::hasPlan(options.out));
}

int correctPoses(const fs::path& out, const MapOptions& options, const FlagParser& flags, Messages& messages) {
  if (!tiles::hasPlan(out) && io::isFile(out / "rolling.json", ErrorCode::Output)) {
    throw InvalidArgument("usage.poses", out.string(), "is a folder of --rolling, which keeps no rays",
                          "Map all scans with the corrected poses and another --rolling folder");
  }
  const OpenJob open = openJob(out, options);
  std::optional<std::string> reason = whyNotInTiles(open.options, open.job.params);
  if (open.job.params.change.mode == ChangeMode::Full) reason = "--change full makes no tile without the others";
  if (reason) {
    throw InvalidArgument("usage.poses", out.string(), "cannot be made again in part: " + *reason,
                          "Map all scans with the corrected poses into another folder");
  }
  const std::size_t n = flightNamed(open.job.plan, open, options.scans);
  if (open.flights[n].scans.empty()) {
    throw InvalidArgument("usage.poses", out.string(), "was made by live: its scans are in no file",
                          "Record the flight, and map the recording with the corrected poses");
  }
  const PlanSettings settings = correctedSettings(open.job.plan.flights[n].settings, flags);
  MapOptions corrected = flightOptions(open, settings);
  corrected.allow_disagreement = options.allow_disagreement;
  const std::string subject = !options.poses.empty()              ? options.poses
                              : options.survey.trajectory.empty() ? options.survey.stations
                                                                  : options.survey.trajectory;
  requireNoInputsInTiles(out, namedInputs(corrected));
  io::ScanSequence now = io::ScanSequence::open(scanInputOptions(corrected));
  sayAboutScans(now, messages);
  const std::optional<io::ScanSequence> before = scansBefore(open, n);
  requireSameScans(now, before, open.job.plan.flights[n], subject);
  std::vector<PosePair> pairs = posePairs(now, before);
  requireNear(pairs, subject);
  if (now.deskews() || (before && before->deskews())) pairs.clear();  // more than one of each scan
  static_cast<void>(checkAgreement(corrected, open.job.params.tsdf.range_noise_m, now, messages));

  const Moves moves = movesOf(now, pairs, longestRays_m(open, n), open.job.params.tsdf, messages);
  if (moves.stopped) return 128 + stopSignal();
  const std::string most = "half a voxel, " + numberText(open.job.params.tsdf.voxel_size_m / 2) + " m";
  if (!pairs.empty() && moves.count == 0) {
    messages.notice("no scan moves by more than " + most + ": the map stays as it is");
    return 0;
  }
  const PlanSources sources = {corrected, settings, open.tools, now, open.job.params};
  std::optional<tiles::Flight> flight;
  if (!pairs.empty()) flight = inEffect(open, n, sources, pairs, moves);
  if (flight) {
    messages.notice(std::to_string(moves.count) + " of " + std::to_string(pairs.size()) + " scans move by more than " +
                    most + ", their sensors by up to " + numberText(moves.most_m) +
                    " m; the others stay where they are. Poses in effect: " + (out / flight->poses_in_effect).string());
  } else {
    flight = flightOf(sources, settings);
    messages.notice(std::string("all scans take the new poses: ") +
                    (!before || before->size() != now.size() ? "those of before are not known any more"
                                                             : "their returns have more than one pose each") +
                    ". Tiles stay where rays are the same to the bit");
  }
  tiles::Plan plan = open.job.plan;
  plan.flights[n] = *std::move(flight);
  tiles::writePlan(out, identified(std::move(plan)));
  messages.notice("next: accessvdb tile bin " + out.string() + ", tile run, tile merge");
  return 0;
}

}  // namespace accessvdb::tools
