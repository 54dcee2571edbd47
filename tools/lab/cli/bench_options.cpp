// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bench_options.h"

#include <cmath>
#include <utility>

#include "accessvdb/error.h"
#include "options/options.h"
#include "options/tools_given.h"

namespace accessvdb::tools {
namespace {

/// Rays tried per frame, times its returns: in the forest about two thirds yield a return. On an orbit with a range of
/// 6 m it is one in nine near the tops of the trees.
constexpr int kRaysPerReturn = 8, kRaysPerReturnOnOrbit = 24;
constexpr int kMostFrames = 100'000, kMostPoints = 1'000'000;

void requireWhole(const char* flag, int value, int most) {
  if (value >= 1 && value <= most) return;
  throw InvalidArgument("usage.number", flag, std::to_string(value) + " is outside 1 .. " + std::to_string(most),
                        "See accessvdb-lab bench --help");
}

/// Only where it cannot be seen in the labels: the paper's policy and points that wait depend on when updates were
/// made. Pipelined, each scan has an update that runs beside the next one.
void checkWarmUp(const BenchOptions& options) {
  constexpr const char* kFlag = "--warm-up-update-every";
  requireWhole(kFlag, options.warm_up_update_every, kMostFrames);
  if (options.warm_up_update_every == 1) return;
  if (!options.shortest) {
    throw InvalidArgument("usage.shortest", kFlag, "has no meaning without --shortest",
                          "Add --shortest and --min-surface-points");
  }
  const auto refuseWith = [&](bool given, const std::string& what) {
    if (given) throw InvalidArgument("usage.warm_up", kFlag, "does not go with " + what, "Update after every scan");
  };
  refuseWith(benchFieldParams(options).update.policy != UpdatePolicy::Exact, "the paper's policy");
  refuseWith(options.budget_points > 0, "--budget-points");
  refuseWith(options.pipelined, "--pipelined");
}

void checkRate(const BenchOptions& options) {
  constexpr const char* kFlag = "--scans-per-second";
  constexpr double kSlowest = 0.1, kFastest = 1000;
  const double rate = options.scans_per_second;
  if (rate == 0) return;
  if (!(rate >= kSlowest && rate <= kFastest)) {
    throw InvalidArgument("usage.number", kFlag,
                          numberText(rate) + " is outside " + numberText(kSlowest) + " .. " + numberText(kFastest),
                          "Use for example 10, or 0 for as fast as possible");
  }
  if (options.pipelined) {
    throw InvalidArgument("usage.rate", kFlag, "does not go with --pipelined, which counts how many fit into a second",
                          "Leave out one of the two");
  }
}

}  // namespace

void addBenchOptions(FlagParser& flags, BenchOptions& options) {
  flags.describe("bench", "Replays a simulated flight among pines timing every stage of every frame.",
                 "accessvdb-lab bench --scene pine --frames 600 --voxel 0.01 --out bench.json\n"
                 "  accessvdb-lab bench --path orbit --max-range 10 --voxel 0.01 --tau 0.1 --frames 1700 --shortest "
                 "--min-surface-points 3200000 --max-new-percent 6 --begin-by 1500 --out orbit.json");
  addCommonOptions(flags, options.map.common);
  flags.option("--scene", &options.scene, "scene to fly through: pine");
  flags.option("--path", &options.path,
               "flight: along a lane, never the same place twice; orbit: laps of 5 m radius around a group of pines; "
               "hover: along the lane at 0.01 m/s");
  flags.option("--frames", &options.frames,
               "number of scans; an update follows each, unless --warm-up-update-every is given");
  flags.option("--timed-frames", &options.timed_frames,
               "number of last scans that the figures cover; by default all of them, if there are fewer");
  flags.option("--min-surface-points", &options.min_surface_points,
               "fail if the map has fewer points when the timed part begins");
  flags.flag("--shortest", options.shortest,
             "begin the timed part as soon as --min-surface-points are reached; --frames is the limit");
  flags.option("--max-new-percent", &options.max_new_percent,
               "with --shortest, begin only when at most this share of the returns, over as many frames as are timed, "
               "made new points");
  flags.option("--begin-by", &options.begin_by,
               "with --shortest, begin after this many frames in any case; with --warm-up-update-every, 20 later");
  flags.option(
      "--warm-up-update-every", &options.warm_up_update_every,
      "with --shortest and the exact policy, update only after every n-th scan until 20 frames before the timed "
      "part: gets there sooner, with the same labels. Not with --budget-points or --pipelined");
  flags.flag("--pipelined", options.pipelined,
             "fuse each scan while the one before is scored: measures frames per second, not the time to a label");
  flags.option(
      "--scans-per-second", &options.scans_per_second,
      "begin the timed frames at this rate, so that work that is left behind has the time that a scanner gives "
      "it; waiting does not count. 0 = as fast as possible");
  flags.option("--points-per-frame", &options.points_per_frame, "exact number of returns per scan");
  flags.option("--sensor-rate", &options.sensor_rate_hz, "scans per second");
  flags.option("--speed", &options.speed_m_s, "speed along the path, metres per second; default: 1, hovering 0.01");
  flags.option("--range-noise", &options.range_noise_m, "sigma of the ranges, simulated and assumed, metres");
  flags.option("--min-range", &options.min_range_m, "nearer returns are lost, metres");
  flags.option("--max-range", &options.max_range_m, "farther returns are lost, metres; the forest extends as far");
  flags.option("--solid-foliage", &options.solid_foliage_m,
               "model shoots as solid bodies of this radius, metres, as a wide beam sees them; 0 = every needle");
  flags.option("--seed", &options.seed, "seed of the forest and the noise");
  options.map.tool.tool = "builtin:pruner";
  addToolsOptions(flags, options.map);
  flags.option("--voxel", &options.map.voxel_m, "edge of a voxel in metres");
  flags.option("--tau", &options.map.tau, "truncation distance in metres, or in voxels (4v); default by rule");
  flags.option("--profile", &options.map.profile, "product or paper");
  flags.option("--policy", &options.map.policy, "how points to be scored again are chosen: exact or paper");
  flags.option("--budget-points", &options.budget_points, "most points scored per update; 0 = no limit");
  addOrientationOptions(flags, options.map);
  flags.option("--knn", &options.map.knn, "neighbours of a normal; default by rule");
  addPointsOptions(flags, options.map);
  flags.option("--corridor", &options.map.corridor_m, "length of the straight corridor that must be free, metres");
  addMirrorOption(flags, options.map);
  addFusionOptions(flags, options.map);
  addChangeOptions(flags, options.map);
  addClearOptions(flags, options.map);
  flags.option("--per-frame", &options.per_frame, "CSV file for the figures of every frame");
  flags.option("--out", &options.out, "JSON file for the figures; default: standard output");
}

void checkBenchOptions(const BenchOptions& options) {
  checkCommonOptions(options.map.common);
  if (options.scene != "pine") {
    throw InvalidArgument("usage.scene", "--scene", "\"" + options.scene + "\" is not a scene of bench", "Use pine");
  }
  if (options.path != "flight" && options.path != "orbit" && options.path != "hover") {
    throw InvalidArgument("usage.path", "--path", "\"" + options.path + "\" is not a path of bench",
                          "Use flight, orbit or hover");
  }
  requireWhole("--frames", options.frames, kMostFrames);
  requireWhole("--timed-frames", options.timed_frames, kMostFrames);
  requireWhole("--points-per-frame", options.points_per_frame, kMostPoints);
  if (options.timed_frames > options.frames) {
    throw InvalidArgument("usage.timed_frames", "--timed-frames",
                          "there are only " + std::to_string(options.frames) + " frames",
                          "Time fewer frames, or increase --frames");
  }
  if (options.shortest && options.min_surface_points == 0) {
    throw InvalidArgument("usage.shortest", "--shortest", "has no meaning without --min-surface-points",
                          "Set the number of points that the map must have");
  }
  if (!options.shortest && (options.max_new_percent || options.begin_by)) {
    throw InvalidArgument("usage.shortest", options.max_new_percent ? "--max-new-percent" : "--begin-by",
                          "has no meaning without --shortest", "Add --shortest and --min-surface-points");
  }
  checkWarmUp(options);
  checkRate(options);
  if (options.begin_by) {
    requireWhole("--begin-by", *options.begin_by, options.frames - options.timed_frames - settlingFrames(options));
  }
  if (options.budget_points < 0) {
    throw InvalidArgument("usage.number", "--budget-points", std::to_string(options.budget_points) + " is below 0",
                          "Use 0 for no limit");
  }
  const auto requirePositive = [](const char* flag, double value, double most) {
    if (value > 0 && value <= most) return;
    throw InvalidArgument("usage.number", flag, numberText(value) + " is outside 0 .. " + numberText(most),
                          "See accessvdb-lab bench --help");
  };
  requirePositive("--sensor-rate", options.sensor_rate_hz, 1000);
  requirePositive("--speed", benchSpeed_m_s(options), 100);
  if (options.max_new_percent) requirePositive("--max-new-percent", *options.max_new_percent, 100);
  // The forest of an orbit extends farther than the sensor sees.
  requirePositive("--max-range", options.max_range_m, options.path == "orbit" ? 190 : 200);
  if (!(options.solid_foliage_m >= 0 && options.solid_foliage_m <= 0.5)) {
    throw InvalidArgument("usage.number", "--solid-foliage",
                          numberText(options.solid_foliage_m) + " is outside 0 .. 0.5", "Use for example 0.05");
  }
  (void)benchSensor(options);
  (void)benchFieldParams(options);
}

FieldParams benchFieldParams(const BenchOptions& options) {
  MapOptions map = options.map;
  map.range_noise_m = options.range_noise_m;
  FieldParams params = fieldParams(map);
  params.update.budget_points = options.budget_points;
  return params;
}

sim::LidarModel benchSensor(const BenchOptions& options) {
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.rays_per_frame = (options.path == "orbit" ? kRaysPerReturnOnOrbit : kRaysPerReturn) * options.points_per_frame;
  model.frame_period_s = 1 / options.sensor_rate_hz;
  model.range_noise_m = options.range_noise_m;
  model.min_range_m = options.min_range_m;
  model.max_range_m = options.max_range_m;
  model.validate();
  return model;
}

double benchSpeed_m_s(const BenchOptions& options) {
  return options.speed_m_s.value_or(options.path == "hover" ? 0.01 : 1.0);
}

sim::Trajectory benchTrajectory(const BenchOptions& options) {
  const double period_s = 1 / options.sensor_rate_hz, speed_m_s = benchSpeed_m_s(options);
  return options.path == "orbit" ? sim::forestOrbit(speed_m_s, period_s, options.frames)
                                 : sim::forestFlight(speed_m_s, period_s, options.frames);
}

sim::ForestParams benchForest(const BenchOptions& options) {
  sim::ForestParams forest;
  forest.path_length_m = benchSpeed_m_s(options) / options.sensor_rate_hz * options.frames;
  forest.view_m = options.max_range_m;
  if (options.path == "orbit") {
    forest.clearing = true;
    forest.path_length_m = 1;
    forest.view_m += sim::kOrbitRadius_m;
  }
  forest.solid_foliage_m = options.solid_foliage_m;
  forest.seed = options.seed;
  return forest;
}

}  // namespace accessvdb::tools
