// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is called gone (ChangeMode::Full): ghosts of a person who walked through, and, in still scenes, points that
/// stand and are called gone all the same.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tsdf_volume.h"
#include "eval/table_context.h"
#include "sim/changing_scene.h"
#include "sim/pine.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

FieldParams paramsOf(const TableContext& context, double voxel_m, double noise_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.tsdf.range_noise_m = noise_m;
  params.change.mode = ChangeMode::Full;
  params.origin_W = {{0, 0, 0}};
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  return params;
}

TableRow rowOf(const std::string& scene, const std::string& variant, double voxel_m) {
  TableRow row;
  row.table = "gone";
  row.scene = scene;
  row.method = "product";
  row.variant = variant;
  row.voxel_m = voxel_m;
  return row;
}

/// Where the person of the changing scene walked, as far as the board of 3 x 2 m at 2 m is behind, as seen from the
/// origin; the sensor is never far from it. Before the open sky nothing goes.
bool wherePersonWas(const Eigen::Vector3d& p_W) {
  const double to_board = 2 / p_W.x();
  return p_W.x() > 1.05 && p_W.x() < 1.75 && std::abs(p_W.y()) * to_board < 1.3 && std::abs(p_W.z()) * to_board < 0.8;
}

struct Ghosts {
  std::size_t voxels = 0;         ///< that collide
  std::vector<std::uint32_t> in;  ///< points whose own voxel collides
  std::size_t left = 0;           ///< of those that were so at first, the ones that are not called gone
};
Ghosts ghostsIn(const AccessibilityField& field, const std::vector<std::uint32_t>& at_first) {
  Ghosts ghosts;
  const double v = field.volume().voxelSize_m();
  const auto r_c = static_cast<float>(field.params().scoring.collision_distance_m);
  const auto distances = field.volume().distance();
  for (auto voxel = distances->cbeginValueOn(); voxel; ++voxel) {
    const openvdb::Coord ijk = voxel.getCoord();
    ghosts.voxels += *voxel < r_c && wherePersonWas(v * Eigen::Vector3d(ijk.x(), ijk.y(), ijk.z())) ? 1 : 0;
  }
  const FieldSnapshot snapshot = field.snapshot();
  for (const SurfacePoint& point : snapshot.points) {
    if (!wherePersonWas(point.position_W)) continue;
    const Eigen::Vector3d ijk = (point.position_W / v).array().round();
    const VoxelState state =
        field.volume().at({static_cast<int>(ijk.x()), static_cast<int>(ijk.y()), static_cast<int>(ijk.z())});
    if (state.weight > 0 && state.distance_m < r_c) ghosts.in.push_back(point.id);
  }
  for (const std::uint32_t id : at_first) ghosts.left += snapshot.points[id].reason != PointReason::Changed ? 1 : 0;
  return ghosts;
}

/// A person crosses 0.8 m before a board, 1.2 m from a sensor that stands, but for a hand's sway, or moves along.
TableRow personRow(TableContext& context, double voxel_m, bool moves) {
  constexpr double kNoise_m = 0.005;
  constexpr int kFirst = 270;  // three seconds before the person comes
  sim::ChangingScene scene = sim::changingScene("person", voxel_m);
  if (moves) {
    for (std::size_t n = 0; n < scene.trajectory.size(); ++n) {
      scene.trajectory[n].translation().y() = 0.6 * std::sin(0.05 * static_cast<double>(n));  // 0.3 m/s at most
    }
  }
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kNoise_m;
  const sim::Simulator simulator(scene, model, 1);
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), paramsOf(context, voxel_m, kNoise_m));
  context.device = field.deviceName();
  const int gone = static_cast<int>(std::lround(scene.gone_s / model.frame_period_s));
  int next = kFirst;
  std::vector<std::uint32_t> at_first;
  const auto fuseUntil = [&](int scan) {
    for (; next < scan; ++next) {
      context.options.observer.checkStop();
      const sim::SimulatedFrame frame = simulator.frame(next);
      field.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
    }
    field.update();
    return ghostsIn(field, at_first);
  };
  const auto percent = [](std::size_t part, std::size_t whole) {
    return 100 * static_cast<double>(part) / static_cast<double>(std::max<std::size_t>(whole, 1));
  };
  TableRow row = rowOf("person", moves ? "moving sensor" : "standing sensor", voxel_m);
  const Ghosts first = fuseUntil(gone);
  at_first = first.in;
  const Ghosts after_3_s = fuseUntil(gone + 30), after_10_s = fuseUntil(gone + 100);
  row.more = {{"ghost_voxels", static_cast<double>(first.voxels)},
              {"ghost_voxels_left_percent_after_3_s", percent(after_3_s.voxels, first.voxels)},
              {"ghost_voxels_left_percent_after_10_s", percent(after_10_s.voxels, first.voxels)},
              {"ghost_points", static_cast<double>(at_first.size())},
              {"ghost_points_left_percent_after_3_s", percent(after_3_s.left, at_first.size())},
              {"ghost_points_left_percent_after_10_s", percent(after_10_s.left, at_first.size())}};
  if (moves && voxel_m >= 0.05) {
    row.must_hold = percent(after_3_s.left, at_first.size()) <= 40 && percent(after_10_s.left, at_first.size()) <= 10;
  }
  return row;
}

/// A pine that nothing happens to. @param noise_m  of the ranges  @param jitter_m  of the poses, which nothing is told
TableRow standingRow(TableContext& context, double noise_m, double jitter_m) {
  constexpr double kVoxel_m = 0.02, kMost_percent = 0.1;
  constexpr int kScans = 600;
  sim::PineParams pine;
  pine.height_m = 6;
  const sim::Scene tree = sim::makePine(pine);
  sim::Helix around;
  around.centre_W = tree.centre_W;
  around.radius_m = 4;
  around.height_begin_m = 1 - tree.centre_W.z();
  around.height_end_m = 4 - tree.centre_W.z();
  around.azimuth_end_rad = 4 * 3.14159265358979;
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = noise_m;
  const sim::Simulator simulator(tree, model, sim::helix(around, kScans), 1);
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"),
                           paramsOf(context, kVoxel_m, std::max(noise_m, jitter_m)));
  context.device = field.deviceName();
  std::mt19937_64 random(1);
  const auto jitter = [&] { return std::normal_distribution<double>(0, 1)(random) * jitter_m; };
  std::vector<std::uint8_t> ever;
  std::size_t now_gone = 0;
  for (int n = 0; n < simulator.frames(); ++n) {
    context.options.observer.checkStop();
    sim::SimulatedFrame frame = simulator.frame(n);
    frame.T_W_S.translation() += Eigen::Vector3d(jitter(), jitter(), jitter());
    field.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
    if (n % 20 != 19) continue;
    field.update();
    const auto points = field.points();
    ever.resize(points->size(), 0);
    now_gone = 0;
    for (std::size_t id = 0; id < points->size(); ++id) {
      if (points->at(id).reason != PointReason::Changed) continue;
      ever[id] = 1;
      ++now_gone;
    }
  }
  TableRow row = rowOf("pine", jitter_m > 0 ? "poses off by 10 mm" : "ranges off by 20 mm", kVoxel_m);
  const double points = static_cast<double>(ever.size());
  const double gone_percent = 100 * static_cast<double>(now_gone) / points;
  row.more = {{"points", points},
              {"standing_points_gone", static_cast<double>(now_gone)},
              {"standing_points_gone_percent", gone_percent},
              {"standing_points_ever_gone", static_cast<double>(std::count(ever.begin(), ever.end(), 1))}};
  row.must_hold = gone_percent <= kMost_percent;
  return row;
}

/// After how many scans without the bar of the changing scene its voxels are what they were before it came: those at
/// the bar, or within a voxel of it, that blocked when it went and had not blocked before.
TableRow barRow(TableContext& context, ChangeMode mode) {
  constexpr double kVoxel_m = 0.02, kTau_m = 0.1, kNoise_m = 0.005, kMostMedian_scans = 12;
  const sim::ChangingScene scene = sim::changingScene("bar", kVoxel_m);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kNoise_m;
  const sim::Simulator simulator(scene, model, 1);
  FieldParams params = paramsOf(context, kVoxel_m, kNoise_m);
  params.tsdf.truncation_distance_m = kTau_m;
  params.change.mode = mode;
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  context.device = field.deviceName();
  int next = 0;
  const auto fuseUntil = [&](int scan) {
    for (; next < scan; ++next) {
      context.options.observer.checkStop();
      const sim::SimulatedFrame frame = simulator.frame(next);
      field.integrateScan(frame.points_S, frame.T_W_S, frame.stamp_s);
    }
  };
  const auto r_c = static_cast<float>(field.params().scoring.collision_distance_m);
  const auto factsAt = [&](const openvdb::Coord& ijk) {
    const VoxelState state = field.volume().at(ijk);
    const bool collides = state.weight > 0 && state.distance_m < r_c;
    return std::pair(collides, state.weight > 0 ? !collides : state.cleared);
  };
  const auto scanAt = [&](double stamp_s) { return static_cast<int>(std::lround(stamp_s / model.frame_period_s)); };
  const sim::ScenePart& bar = scene.parts[scene.first_new];
  fuseUntil(scanAt(scene.change_s));
  struct Voxel {
    openvdb::Coord ijk;
    std::pair<bool, bool> before;
    int scans = 0;  ///< until it is as before
  };
  std::vector<Voxel> voxels;
  const auto [low, high] = std::pair(openvdb::Coord(94, -28, -3), openvdb::Coord(102, 28, 3));
  for (openvdb::CoordBBox::Iterator<true> at(openvdb::CoordBBox(low, high)); at; ++at) {
    const openvdb::Coord& ijk = *at;
    if (bar.scene.distance->at(kVoxel_m * Eigen::Vector3d(ijk.x(), ijk.y(), ijk.z())) > kVoxel_m) continue;
    if (const auto facts = factsAt(ijk); !facts.first) voxels.push_back({ijk, facts});
  }
  const int gone = scanAt(scene.gone_s);
  fuseUntil(gone);
  std::erase_if(voxels, [&](const Voxel& voxel) { return !factsAt(voxel.ijk).first; });
  for (int scans = 1; gone + scans <= simulator.frames(); ++scans) {
    fuseUntil(gone + scans);
    for (Voxel& voxel : voxels) {
      if (voxel.scans == 0 && factsAt(voxel.ijk) == voxel.before) voxel.scans = scans;
    }
  }
  std::vector<int> scans;
  for (const Voxel& voxel : voxels) {
    if (voxel.scans > 0) scans.push_back(voxel.scans);
  }
  std::sort(scans.begin(), scans.end());
  // The rest has not come by the end: in the order of scans it is behind all others.
  const auto within = [&](double share) {
    const auto n = static_cast<std::size_t>(share * static_cast<double>(voxels.size() - 1));
    return n < scans.size() ? static_cast<double>(scans[n]) : std::numeric_limits<double>::infinity();
  };
  TableRow row = rowOf("bar", mode == ChangeMode::Full ? "full" : "block", kVoxel_m);
  row.more = {{"voxels", static_cast<double>(voxels.size())},
              {"scans_until_as_before_median", within(0.5)},
              {"scans_until_as_before_90_percent", within(0.9)},
              {"not_as_before_at_the_end", static_cast<double>(voxels.size() - scans.size())},
              {"scans_at_the_end", static_cast<double>(simulator.frames() - gone)}};
  row.must_hold = !voxels.empty() && within(0.5) <= kMostMedian_scans;
  return row;
}

}  // namespace

void makeGoneTable(TableContext& context) {
  const auto add = [&](const TableRow& row) {
    std::string line = "gone: " + row.scene + ", " + row.variant;
    for (const auto& [name, value] : row.more) line += ", " + name + " " + std::to_string(value);
    context.options.observer.say(line);
    context.rows.push_back(row);
  };
  add(barRow(context, ChangeMode::Block));
  add(barRow(context, ChangeMode::Full));
  add(personRow(context, 0.05, true));
  add(personRow(context, 0.05, false));
  add(personRow(context, 0.02, true));
  add(standingRow(context, 0.02, 0));
  add(standingRow(context, 0, 0.01));
}

}  // namespace accessvdb::eval
