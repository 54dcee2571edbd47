// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "simulate_options.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "accessvdb/error.h"
#include "options/options.h"
#include "sim/angles.h"
#include "sim/pine.h"
#include "sim/scene_catalogue.h"

namespace accessvdb::tools {
namespace {

using sim::kDegree, sim::kTurn;

constexpr int kStationsPerTurn = 720;
constexpr int kLargeSceneFrames = 1000;
constexpr double kLargeSceneTurns = 5;
constexpr double kMostTurns = 1000;  // each turn has its stations

bool isBenchmark(const std::string& scene) {
  const std::vector<std::string> names = sim::benchmarkSceneNames();
  return std::find(names.begin(), names.end(), scene) != names.end();
}

/// For scenes without a path of their own: five turns around the middle, at 1.5 times the scene's reach plus half a
/// metre, over most of its height.
sim::Helix pathAround(const sim::Scene& scene) {
  double reach_m = 0, half_height_m = 0;
  for (const Eigen::Vector3f& vertex_W : scene.mesh.vertices_W) {
    const Eigen::Vector3d offset = vertex_W.cast<double>() - scene.centre_W;
    reach_m = std::max(reach_m, std::hypot(offset.x(), offset.y()));
    half_height_m = std::max(half_height_m, std::abs(offset.z()));
  }
  sim::Helix path;
  path.centre_W = scene.centre_W;
  path.radius_m = 1.5 * reach_m + 0.5;
  path.height_begin_m = -0.8 * half_height_m;
  path.height_end_m = 0.8 * half_height_m;
  path.azimuth_end_rad = kLargeSceneTurns * kTurn;
  return path;
}

std::optional<LengthUnit> meshUnit(const std::string& text) {
  if (text.empty()) return std::nullopt;
  if (text == "m") return LengthUnit::Metre;
  if (text == "cm") return LengthUnit::Centimetre;
  if (text == "mm") return LengthUnit::Millimetre;
  if (text == "in") return LengthUnit::Inch;
  throw InvalidArgument("usage.mesh_unit", "--mesh-unit", "\"" + text + "\" is not a unit", "Use m, cm, mm or in");
}

nlohmann::ordered_json numbers(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

void refuseWith(const std::string& trajectory, bool given, const char* flag) {
  if (!given) return;
  throw InvalidArgument("usage.trajectory", flag, "does not apply to --trajectory " + trajectory,
                        "Omit it, or choose another trajectory");
}

/// A moving sensor ends its last scan at a pose of its own.
int posesFor(const SimulateOptions& options, const SceneView& view) {
  return options.frames.value_or(view.frames) + (options.moving ? 1 : 0);
}

SimulatedPath pathFromFile(const SimulateOptions& options) {
  SimulatedPath path;
  path.poses = sim::readTrajectory(options.trajectory);
  const int more = options.moving ? 1 : 0;
  const int available = static_cast<int>(path.poses.size()) - more, wanted = options.frames.value_or(available);
  if (wanted > available) {
    throw UnusableInput(
        "sim.frames", options.trajectory,
        "holds " + std::to_string(available) + " poses, but --frames asks for " + std::to_string(wanted),
        "Use fewer --frames");
  }
  path.poses.resize(static_cast<std::size_t>(wanted + more));
  path.stations = path.poses;
  path.description = {{"kind", "file"}, {"file", options.trajectory}};
  return path;
}

/// Past the object on its -y side, along +x, twice as far as its distance; halfway along the walk, a level sensor has
/// the object at its side, in the middle of its view.
SimulatedPath pathOfWalk(const SimulateOptions& options, const SceneView& view, const sim::LidarModel& model) {
  const double radius_m = options.radius_m.value_or(view.path.radius_m);
  const double height_m = options.height_m.value_or(-radius_m * std::tan(model.middleElevation_rad()));
  const Eigen::Vector3d nearest_W = view.scene.centre_W + Eigen::Vector3d(0, -radius_m, height_m);
  Eigen::Vector3d begin_W = nearest_W - Eigen::Vector3d(2 * radius_m, 0, 0);
  Eigen::Vector3d end_W = nearest_W + Eigen::Vector3d(2 * radius_m, 0, 0);
  if (!options.begin.empty()) begin_W = parseVector("--begin", options.begin);
  if (!options.end.empty()) end_W = parseVector("--end", options.end);
  SimulatedPath path;
  path.poses = sim::walk(begin_W, end_W, options.pitch_deg * kDegree, posesFor(options, view));
  path.stations = sim::walk(begin_W, end_W, 0, 2);
  path.description = {
      {"kind", "walk"}, {"begin_m", numbers(begin_W)}, {"end_m", numbers(end_W)}, {"pitch_deg", options.pitch_deg}};
  return path;
}

SimulatedPath pathAroundObject(const SimulateOptions& options, const SceneView& view, const sim::LidarModel& model) {
  const bool level = options.trajectory == "orbit";
  sim::Helix shape = view.path;
  shape.centre_W = view.scene.centre_W;
  shape.object_elevation_rad = model.middleElevation_rad();
  shape.radius_m = options.radius_m.value_or(shape.radius_m);
  if (options.height_m) {
    shape.height_begin_m = level ? *options.height_m : -*options.height_m;
    shape.height_end_m = *options.height_m;
  } else if (level) {
    shape.height_begin_m = shape.height_end_m = 0;
  }
  if (options.turns) {
    shape.azimuth_end_rad = shape.azimuth_begin_rad + *options.turns * kTurn;
    shape.sweeps = 1;
  }
  const int frames = posesFor(options, view);
  SimulatedPath path;
  path.poses = level ? sim::orbit(shape, frames) : sim::helix(shape, frames);
  if (level) shape.azimuth_end_rad = shape.azimuth_begin_rad + kTurn;
  if (level) shape.sweeps = 1;
  const double turns = shape.sweeps * std::abs(shape.azimuth_end_rad - shape.azimuth_begin_rad) / kTurn;
  path.stations = sim::helix(shape, 2 + static_cast<int>(std::ceil(turns * kStationsPerTurn)));
  path.description = {{"kind", level ? "orbit" : "helix"},
                      {"centre_m", numbers(shape.centre_W)},
                      {"radius_m", shape.radius_m},
                      {"height_begin_m", shape.height_begin_m},
                      {"height_end_m", shape.height_end_m},
                      {"azimuth_begin_deg", shape.azimuth_begin_rad / kDegree},
                      {"azimuth_end_deg", shape.azimuth_end_rad / kDegree},
                      {"sweeps", shape.sweeps},
                      {"object_elevation_deg", shape.object_elevation_rad / kDegree}};
  return path;
}

}  // namespace

void addSimulateOptions(FlagParser& flags, SimulateOptions& options) {
  flags.describe(
      "simulate", "Simulates scans of a scene: PCD scans, TUM poses, the mesh and a description.",
      "accessvdb-lab simulate --scene torus --out torus/\n"
      "  accessvdb map --scans torus/scans --poses torus/poses.txt --tool builtin:pencil --voxel 0.002 "
      "--out out/\n"
      "  accessvdb-lab simulate --scene part.stl --mesh-unit mm --trajectory orbit --frames 100 --out part/");
  addCommonOptions(flags, options.common);
  flags.option("--scene", &options.scene,
               "torus, sphere, box, wall, ring, pine, a scene from the tables (sphere_a, sphere_b, unseen_1 to "
               "unseen_6, table_underside, open_box, branch_below, cone_well, slot), or a mesh file");
  flags.option("--mesh-unit", &options.mesh_unit, "unit of the mesh: m, cm, mm or in (required for STL, OBJ, PLY)");
  flags.option("--voxel", &options.voxel_m, "ring: the radius of its tube is 1.5 such voxels, metres");
  flags.option("--tree-height", &options.tree_height_m, "pine: height of the tree, metres");
  flags.option("--sensor", &options.sensor, "mid360 (20000 rays, non-repetitive) or spinning (64 x 1024)");
  flags.option("--trajectory", &options.trajectory,
               "orbit, helix, walk, or a file of TUM poses; default: the scene's own (docs/PAPER.md)");
  flags.option("--frames", &options.frames, "number of scans; default: the scene's own, or all poses of the file");
  flags.option("--radius", &options.radius_m, "distance of the path from the object's middle, metres");
  flags.option("--height", &options.height_m,
               "height of an orbit or walk above the object's middle, metres; a helix goes from -height to height");
  flags.option("--turns", &options.turns, "turns of a helix, up to 1000; negative: in the opposite direction");
  flags.option("--begin", &options.begin, "X,Y,Z where a walk begins");
  flags.option("--end", &options.end, "X,Y,Z where a walk ends");
  flags.option("--pitch", &options.pitch_deg, "walk: nose down by this angle, degrees");
  flags.option("--seed", &options.seed, "seed of noise, dropouts and the pine; the same seed gives the same bytes");
  flags.option("--range-noise", &options.range_noise_m, "standard deviation of the ranges, metres");
  flags.option("--dropout", &options.dropout, "share of returns that are lost, 0 to 1");
  flags.option("--min-range", &options.min_range_m, "nearer returns are lost, metres");
  flags.option("--max-range", &options.max_range_m, "farther returns are lost, metres; default: none");
  flags.flag("--moving", options.moving,
             "the sensor moves while it scans, 0.1 s each: scans get a field t, poses are 5 ms apart");
  flags.option("--out", &options.out, "output folder");
}

void checkSimulateOptions(const SimulateOptions& options) {
  checkCommonOptions(options.common);
  for (const auto& [flag, value] : {std::pair{"--scene", &options.scene}, std::pair{"--out", &options.out}}) {
    if (value->empty()) {
      throw InvalidArgument("usage.missing", flag, "is missing", "See accessvdb-lab simulate --help");
    }
  }
  if (options.frames && *options.frames < 1) {
    throw UnusableInput("sim.frames", "--frames", "there are no frames to simulate", "Use at least one");
  }
  const auto requireFinite = [](const char* flag, double value, bool positive) {
    if (std::isfinite(value) && std::abs(value) <= 1e5 && (!positive || value > 0)) return;
    throw InvalidArgument("usage.number", flag,
                          numberText(value) + (positive ? " is not a positive" : " is not a sensible") + " number",
                          "See accessvdb-lab simulate --help");
  };
  if (options.radius_m) requireFinite("--radius", *options.radius_m, true);
  if (options.height_m) requireFinite("--height", *options.height_m, false);
  if (options.turns && !(std::abs(*options.turns) <= kMostTurns)) {
    throw InvalidArgument("usage.number", "--turns",
                          numberText(*options.turns) + " is not a number of turns from -1000 to 1000",
                          "See accessvdb-lab simulate --help");
  }
  requireFinite("--pitch", options.pitch_deg, false);
  requireFinite("--voxel", options.voxel_m, true);
  requireFinite("--tree-height", options.tree_height_m, true);

  const std::string& kind = options.trajectory;
  if (kind == "walk") {
    refuseWith(kind, options.turns.has_value(), "--turns");
    return;
  }
  refuseWith(kind.empty() ? "helix" : kind, !options.begin.empty(), "--begin");
  refuseWith(kind.empty() ? "helix" : kind, !options.end.empty(), "--end");
  refuseWith(kind.empty() ? "helix" : kind, options.pitch_deg != 0, "--pitch");
  if (kind.empty() || kind == "helix") return;
  refuseWith(kind, options.turns.has_value(), "--turns");
  if (kind == "orbit") return;
  refuseWith(kind, options.radius_m.has_value(), "--radius");
  refuseWith(kind, options.height_m.has_value(), "--height");
}

sim::LidarModel lidarModel(const SimulateOptions& options) {
  sim::LidarModel model = sim::LidarModel::named(options.sensor);
  model.range_noise_m = options.range_noise_m;
  model.dropout = options.dropout;
  model.min_range_m = options.min_range_m;
  model.moves = options.moving;
  if (options.max_range_m) model.max_range_m = *options.max_range_m;
  model.validate();
  return model;
}

SceneView sceneView(const SimulateOptions& options) {
  SceneView view;
  const std::string benchmark = options.scene == "sphere" ? "sphere_a" : options.scene;
  if (isBenchmark(benchmark)) {
    sim::BenchmarkScene made = sim::benchmarkScene(benchmark, options.voxel_m);
    view = {std::move(made.scene), made.path, made.frames};
    view.scene.name = options.scene;
    return view;
  }
  if (options.scene == "pine") {
    view.scene = sim::makePine({options.tree_height_m, options.seed});
  } else {
    const std::filesystem::path mesh = options.scene;
    std::error_code status;
    if (!mesh.has_extension() && !std::filesystem::exists(mesh, status)) {
      throw InvalidArgument("sim.scene", options.scene, "is neither a scene nor a mesh file",
                            "Use torus, sphere, box, wall, ring, pine or the path of a mesh");
    }
    view.scene = sim::makeMeshScene(mesh, meshUnit(options.mesh_unit));
  }
  view.path = pathAround(view.scene);
  view.frames = kLargeSceneFrames;
  return view;
}

SimulatedPath simulatedPath(const SimulateOptions& options, const SceneView& view, const sim::LidarModel& model) {
  if (options.trajectory.empty() || options.trajectory == "helix" || options.trajectory == "orbit") {
    return pathAroundObject(options, view, model);
  }
  return options.trajectory == "walk" ? pathOfWalk(options, view, model) : pathFromFile(options);
}

}  // namespace accessvdb::tools
