// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/action_scenes.h"

#include <limits>
#include <numbers>

#include "accessvdb/tool_spec.h"
#include "sim/pine.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

ActionScene scannedPine(TableContext& context) {
  constexpr double kVoxel_m = 0.05;
  constexpr int kFrames = 1200;  // ten a second, at 1 m/s
  const Observer& observer = context.options.observer;
  sim::PineParams pine;
  observer.say("growing a pine");
  const sim::Scene tree = sim::makePine(pine);
  sim::Helix shape;
  shape.centre_W = tree.centre_W;
  shape.radius_m = 4.5;
  shape.height_begin_m = 1 - tree.centre_W.z();
  shape.height_end_m = pine.height_m - tree.centre_W.z();
  shape.azimuth_end_rad = 4 * 2 * std::numbers::pi;
  const sim::Simulator simulator(tree, sim::LidarModel::named("mid360"), sim::helix(shape, kFrames), 1);
  FieldParams params = clearedParams(context, kVoxel_m);
  params.tsdf.clear_rays_m = 20;
  params.tsdf.platform_radius_m = 0.6;
  ActionScene scene = {
      "pine",
      tree.distance,
      AccessibilityField(withMargins({{ToolGeometry::builtin("builtin:pruner")}}, {kVoxel_m, 2 * kVoxel_m}), params),
      {},
      {}};
  for (int n = 0; n < simulator.frames(); ++n) {
    observer.checkStop();
    const sim::SimulatedFrame frame = simulator.frame(n);
    if (n == 0) scene.start_W = frame.T_W_S.translation();
    scene.box_W.extend(frame.T_W_S.translation());
    (void)scene.field.integrateScan(frame.points_S, frame.T_W_S);
  }
  scene.box_W = Eigen::AlignedBox3d(scene.box_W.min().array() - 0.5, scene.box_W.max().array() + 0.5);
  observer.say("scoring");
  return scene;
}

ActionScene scannedBenchmark(TableContext& context, const std::string& name) {
  const ToolGeometry pencil = ToolGeometry::builtin("builtin:pencil");
  ScanRequest request;
  request.scene = name;
  request.voxel_size_m = 0.005;
  const std::shared_ptr<const StoredScans> scans = context.scans.get(request);
  FieldParams params = clearedParams(context, request.voxel_size_m);
  params.tsdf.platform_radius_m = pencil.reach_m() + 0.05;  // what carried the sensor
  ActionScene scene = {name,
                       scans->benchmark.scene.distance,
                       AccessibilityField(pencil, params),
                       {},
                       scans->frames.front().T_W_S.translation()};
  for (const StoredFrame& frame : scans->frames) {
    context.options.observer.checkStop();
    scene.box_W.extend(frame.T_W_S.translation());
    (void)scene.field.integrateScan(frame.hits_S, frame.T_W_S);
  }
  scene.box_W = Eigen::AlignedBox3d(scene.box_W.min().array() - 0.1, scene.box_W.max().array() + 0.1);
  scene.spacing_m = scene.stand_off_m = 10 * request.voxel_size_m;
  return scene;
}

}  // namespace

FieldParams clearedParams(const TableContext& context, double voxel_size_m) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_size_m;
  params.tsdf.range_noise_m = 0;
  params.tsdf.clear_rays_m = std::numeric_limits<double>::infinity();
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  return params;
}

ActionScene makeActionScene(TableContext& context, const std::string& name) {
  ActionScene scene = name == "pine" ? scannedPine(context) : scannedBenchmark(context, name);
  context.device = scene.field.deviceName();
  (void)scene.field.update();
  return scene;
}

}  // namespace accessvdb::eval
