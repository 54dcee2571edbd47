// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Sets of orientations: what a tool reaches that tilts or rolls, against exact ground truth over the same set.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "eval/ground_truth.h"
#include "eval/table_context.h"
#include "eval/truth_orientations.h"
#include "sim/tilt_scenes.h"

namespace accessvdb::eval {
namespace {

using TableClock = std::chrono::steady_clock;
double secondsFrom(TableClock::time_point start) {
  return std::chrono::duration<double>(TableClock::now() - start).count();
}

/// A set as the method and as the truth know it, each from its own generator.
struct CheckedSet {
  std::string words;
  OrientationSet method;
  int num_directions = 180;
  int rolls = 1;
  std::vector<Eigen::Matrix3d> truth;
};

CheckedSet setOf(const std::string& text, int num_directions, const std::string& more = {}) {
  CheckedSet set = {text + more, OrientationSet::parse(text), num_directions, 1,
                    truthOrientations(text, num_directions)};
  set.words += " (" + std::to_string(set.truth.size()) + ")";
  return set;
}

/// The same with rolls, for tools that look the same after half a turn.
CheckedSet rolledSetOf(const std::string& text, int rolls) {
  CheckedSet set = {text + ", " + std::to_string(rolls) + " rolls", OrientationSet::parse(text), 180, rolls,
                    rolled(truthOrientations(text, 180), rolls, 2)};
  set.words += " (" + std::to_string(set.truth.size()) + ")";
  return set;
}

/// A tool whose roll matters: a tip like the pencil's, and a blade 0.2 m long, 0.12 m wide and 12 mm thick.
ToolGeometry saw() {
  std::vector<Eigen::Vector3f> vertices_T = {{0, 0, 0}};
  for (const auto& [x, half_y, half_z] :
       {std::array{0.05f, 0.006f, 0.006f}, {0.05f, 0.06f, 0.006f}, {0.25f, 0.06f, 0.006f}}) {
    for (const auto& [y, z] : {std::pair{-half_y, -half_z}, {half_y, -half_z}, {half_y, half_z}, {-half_y, half_z}}) {
      vertices_T.emplace_back(x, y, z);
    }
  }
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (std::uint32_t n = 0; n < 4; ++n) {
    const std::uint32_t next = (n + 1) % 4;
    triangles.push_back({0, 1 + next, 1 + n});
    triangles.push_back({5 + n, 5 + next, 9 + next});
    triangles.push_back({5 + n, 9 + next, 9 + n});
  }
  for (const auto& [a, b, c] : {std::array<std::uint32_t, 3>{1, 2, 3}, {1, 3, 4}, {9, 10, 11}, {9, 11, 12}}) {
    triangles.push_back({a, b, c});
  }
  triangles.push_back({5, 7, 6});
  triangles.push_back({5, 8, 7});
  return ToolGeometry::fromTriangles(std::move(vertices_T), std::move(triangles), "saw");
}

ToolGeometry quarterPruner() {
  const ToolGeometry pruner = ToolGeometry::builtin("builtin:pruner");
  std::vector<Eigen::Vector3f> vertices_T = pruner.vertices_T();
  for (Eigen::Vector3f& vertex_T : vertices_T) vertex_T *= 0.25f;
  return ToolGeometry::fromTriangles(std::move(vertices_T), pruner.triangles(), "a quarter of builtin:pruner");
}

/// The points that count, as one field labels them.
struct Labelled {
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<std::uint8_t> found;
  TruthOptions truth;
};

Labelled label(TableContext& context, const StoredScans& scans, const ToolGeometry& tool, double voxel_m,
               const CheckedSet& set) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = 0;
  params.approach.num_directions = set.num_directions;
  params.approach.orientations = set.method;
  params.approach.rolls = set.rolls;
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  AccessibilityField field(tool, params);
  context.device = field.deviceName();
  for (const StoredFrame& frame : scans.frames) {
    context.options.observer.checkStop();
    (void)field.integrateScan(frame.hits_S, frame.T_W_S);
  }
  (void)field.update();
  Labelled out;
  out.truth = truthOptions(field.params());
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.confidence < static_cast<float>(field.params().scoring.confidence_min)) continue;
    out.positions_W.push_back(point.position_W);
    out.normals_W.emplace_back(point.normal_W.cast<double>());
    out.found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  return out;
}

std::vector<std::uint8_t> truthOver(const std::vector<Eigen::Matrix3d>& orientations, const StoredScans& scans,
                                    const ToolGeometry& tool, const Labelled& points) {
  TruthOptions options = points.truth;
  options.orientations = orientations;
  return GroundTruth(scans.benchmark.scene.distance, tool, options).accessible(points.positions_W, points.normals_W);
}

/// Of all points, the share that axes 2 degrees apart reach and the set does not; by some of those that it does not.
double missedBySet_percent(const StoredScans& scans, const ToolGeometry& tool, const Labelled& points,
                           const std::vector<std::uint8_t>& truth) {
  constexpr std::size_t kMostTried = 300;
  std::vector<std::size_t> blocked;
  for (std::size_t n = 0; n < truth.size(); ++n) {
    if (truth[n] == 0) blocked.push_back(n);
  }
  Labelled some;
  some.truth = points.truth;
  const std::size_t tried = std::min(blocked.size(), kMostTried);
  for (std::size_t i = 0; i < tried; ++i) {
    const std::size_t n = blocked[i * blocked.size() / tried];
    some.positions_W.push_back(points.positions_W[n]);
    some.normals_W.push_back(points.normals_W[n]);
  }
  if (tried == 0) return 0;
  double reached = 0;
  for (const std::uint8_t free : truthOver(truthOrientations("sphere:2", 180), scans, tool, some)) reached += free;
  return 100 * reached / static_cast<double>(tried) * static_cast<double>(blocked.size()) /
         static_cast<double>(truth.size());
}

double percentOf(double part, double whole) { return whole > 0 ? 100 * part / whole : 0; }

/// Without a requirement: its boom is so small a part of its volume that it passes through walls (docs/PAPER.md).
constexpr const char* kPrunerWords = "a quarter of the pruner";

struct TiltCase {
  std::string scene;
  double voxel_m;
  std::vector<CheckedSet> sets;  ///< the last one is the scene's full set
  std::string tool = {};         ///< in words, unless it is the pencil
};

/// The part that only a tool reaches that tilts: how much of what the full set truly reaches did this set find?
void addHidden(const TiltCase& tilt, const CheckedSet& set, const StoredScans& scans, const Labelled& points,
               const std::vector<std::uint8_t>& truth_of_full, TableRow& row) {
  // The tool's tip may touch within three voxels (TruthOptions::self_exclusion_m), and normals turn within two.
  const sim::HiddenPart part = sim::hiddenPart(tilt.scene, 3 * tilt.voxel_m, tilt.voxel_m);
  double reachable = 0, found = 0;
  for (std::size_t n = 0; n < points.found.size(); ++n) {
    if (truth_of_full[n] == 0 || !part.holds(scans.benchmark.scene, points.positions_W[n])) continue;
    ++reachable;
    found += points.found[n];
  }
  std::string key = "reachable_on_the_" + part.words;
  std::replace(key.begin(), key.end(), ' ', '_');
  row.more.emplace_back(key, reachable);
  row.more.emplace_back("recall_there", percentOf(found, reachable));
  if (set.method.isYaw() && tilt.tool != kPrunerWords) row.must_hold = reachable > 0 && found == 0;
}

void makeRows(TableContext& context, const TiltCase& tilt, const ToolGeometry& tool) {
  const bool has_hidden = sim::tiltScene(tilt.scene).has_value();
  ScanRequest request;
  request.scene = tilt.scene;
  request.voxel_size_m = tilt.voxel_m;
  const std::shared_ptr<const StoredScans> scans = context.scans.get(request);
  std::vector<std::uint8_t> truth_of_full;  // the map's points are the same for every set
  for (const CheckedSet& set : tilt.sets) {
    const bool full = &set == &tilt.sets.back();
    const auto start = TableClock::now();
    const Labelled points = label(context, *scans, tool, tilt.voxel_m, set);
    const double label_s = secondsFrom(start);
    const std::vector<std::uint8_t> truth = truthOver(set.truth, *scans, tool, points);
    if (truth_of_full.size() != points.found.size())
      truth_of_full = truthOver(tilt.sets.back().truth, *scans, tool, points);
    TableRow row;
    row.table = "orientations";
    row.scene = tilt.scene;
    row.method = "product";
    row.variant = (tilt.tool.empty() ? "" : tilt.tool + ", ") + set.words;
    row.voxel_m = tilt.voxel_m;
    row.figures = compare(truth, points.found);
    double accessible = 0;
    for (const std::uint8_t found : points.found) accessible += found;
    row.more.emplace_back("accessible_percent", percentOf(accessible, static_cast<double>(points.found.size())));
    if (full && tilt.scene != "slot") {
      row.more.emplace_back("missed_by_the_set_percent", missedBySet_percent(*scans, tool, points, truth));
    }
    if (has_hidden) addHidden(tilt, set, *scans, points, truth_of_full, row);
    if (has_hidden && !set.method.isYaw() && tilt.tool != kPrunerWords) row.must = Requirement::atLeast(99);
    context.rows.push_back(row);
    char line[200];
    std::snprintf(line, sizeof line, "%s at %g mm, %s: %zu points, F1 %.2f (labels %.1f s, with truth %.1f s)",
                  tilt.scene.c_str(), 1000 * tilt.voxel_m, set.words.c_str(), points.found.size(), row.figures.f1(),
                  label_s, secondsFrom(start));
    context.options.observer.say(line);
  }
}

/// Labels of coarser and coarser spheres against the truth over axes 2 degrees apart.
void makeDensityRows(TableContext& context, const std::string& scene, double voxel_m, const ToolGeometry& tool) {
  ScanRequest request;
  request.scene = scene;
  request.voxel_size_m = voxel_m;
  const std::shared_ptr<const StoredScans> scans = context.scans.get(request);
  std::vector<std::uint8_t> truth;  // the map's points are the same for every set
  for (const char* text : {"sphere:12.5", "sphere:15", "sphere:20", "sphere:30", "sphere:45", "sphere:90"}) {
    const CheckedSet set = setOf(text, 180);
    const Labelled points = label(context, *scans, tool, voxel_m, set);
    if (truth.size() != points.found.size())
      truth = truthOver(truthOrientations("sphere:2", 180), *scans, tool, points);
    TableRow row;
    row.table = "orientations";
    row.scene = scene;
    row.method = "product";
    row.variant = set.words + " against the truth over sphere:2";
    row.voxel_m = voxel_m;
    row.figures = compare(truth, points.found);
    context.rows.push_back(row);
  }
}

}  // namespace

void makeOrientationsTable(TableContext& context) {
  const CheckedSet yaw = setOf("yaw", 180), sphere = setOf("sphere:12.5", 180),
                   pitch = setOf("pitch:-30:30:10", 36, ", 36 yaws"), few_rolls = rolledSetOf("sphere:30", 4),
                   rolls = rolledSetOf("sphere:12.5", 6);
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  for (const double voxel_m : {0.005, 0.002}) {
    for (const char* scene : {"table_underside", "open_box", "branch_below", "cone_well"}) {
      makeRows(context, {scene, voxel_m, {yaw, pitch, sphere}}, pencil);
    }
    makeRows(context, {"slot", voxel_m, {yaw, pitch, sphere, few_rolls, rolls}, "saw"}, saw());
    makeRows(context, {"slot", voxel_m, {yaw, few_rolls}, kPrunerWords}, quarterPruner());
    for (const char* scene : {"sphere_a", "torus"}) makeRows(context, {scene, voxel_m, {yaw, sphere}}, pencil);
  }
  for (const char* scene : {"open_box", "branch_below", "cone_well"}) makeDensityRows(context, scene, 0.005, pencil);
}

}  // namespace accessvdb::eval
