// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A sensor that moves while it scans: what removing its motion restores, and what happens without.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "accessvdb/accessibility_field.h"
#include "eval/ground_truth.h"
#include "eval/table_context.h"
#include "io/poses/pose_matching.h"
#include "io/scans/scan_motion.h"
#include "sim/scene_catalogue.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kSpeed_m_s = 2, kPeriod_s = 0.1, kMotionVoxel_m = 0.002;
constexpr int kScansAtOnce = 16;
/// Farther from the scans without motion than this is a miss; points of F1.
constexpr double kMostF1 = 0.5;

enum class Motion { None, Removed, Ignored };

/// The benchmark's path, circled as often as it takes to fly it at that speed with as many frames.
sim::Trajectory flightAt(const sim::BenchmarkScene& benchmark) {
  sim::Helix path = benchmark.path;
  const double length_m = kSpeed_m_s * kPeriod_s * benchmark.frames;
  path.azimuth_end_rad = path.azimuth_begin_rad + length_m / path.radius_m;
  path.sweeps = 1;
  return sim::helix(path, benchmark.frames + 1);
}

/// As odometry at 200 Hz would say it.
std::vector<io::PoseEntry> odometryOf(const sim::Trajectory& flight) {
  constexpr int kEach = 20;
  std::vector<io::PoseEntry> poses;
  for (std::size_t n = 0; n + 1 < flight.size(); ++n) {
    for (int i = 0; i < kEach; ++i) {
      const double share = static_cast<double>(i) / kEach;
      poses.push_back(
          {io::interpolateBetween(flight[n], flight[n + 1], share), kPeriod_s * (static_cast<double>(n) + share)});
    }
  }
  poses.push_back({flight.back(), kPeriod_s * static_cast<double>(flight.size() - 1)});
  return poses;
}

void integrate(const sim::SimulatedFrame& frame, Motion motion, const std::vector<io::PoseEntry>& odometry,
               AccessibilityField& field) {
  if (motion != Motion::Removed) {
    (void)field.integrateScan(frame.points_S, frame.T_W_S);
    return;
  }
  const std::vector<double> times(frame.times_ns.begin(), frame.times_ns.end());
  const io::MovedScan moved = io::removeMotion(
      {frame.points_S, times, {1e-9, false}, frame.stamp_s, frame.T_W_S, {}},
      [&](std::int64_t ms) { return io::interpolatePose(odometry, frame.stamp_s + static_cast<double>(ms) * 1e-3); });
  (void)field.integrateRays(moved.points_W, moved.origins_W);
}

struct Judged {
  Confusion figures;
  double off_surface_m = 0;  ///< of 95 % of the points at most: truth is judged where a point is, right or wrong
};

Judged judge(const sim::Scene& scene, const AccessibilityField& field) {
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<std::uint8_t> found;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.confidence < static_cast<float>(field.params().scoring.confidence_min)) continue;
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
  }
  std::vector<double> off_m;
  for (const Eigen::Vector3d& p_W : positions_W) off_m.push_back(std::abs(scene.distance->at(p_W)));
  std::sort(off_m.begin(), off_m.end());
  const GroundTruth truth(scene.distance, field.tool(), truthOptions(field.params()));
  return {compare(truth.accessible(positions_W, normals_W), found), off_m.empty() ? 0 : off_m[off_m.size() * 95 / 100]};
}

Judged fly(TableContext& context, const sim::BenchmarkScene& benchmark, const RunRequest& request, Motion motion) {
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.frame_period_s = kPeriod_s;
  model.moves = motion != Motion::None;
  sim::Trajectory flight = flightAt(benchmark);
  const std::vector<io::PoseEntry> odometry = odometryOf(flight);
  if (!model.moves) flight.pop_back();
  const sim::Simulator simulator(benchmark.scene, model, flight, request.scans.seed);
  FieldParams params = request.params;
  params.backend = context.options.backend;
  params.threads = context.options.threads;
  AccessibilityField field(ToolGeometry::builtin(request.tool), params);
  context.device = field.deviceName();
  std::vector<sim::SimulatedFrame> frames(kScansAtOnce);
  for (int begin = 0; begin < simulator.frames(); begin += kScansAtOnce) {
    context.options.observer.checkStop();
    const int count = std::min(kScansAtOnce, simulator.frames() - begin);
    tbb::parallel_for(0, count, [&](int n) { frames[static_cast<std::size_t>(n)] = simulator.frame(begin + n); });
    for (int n = 0; n < count; ++n) integrate(frames[static_cast<std::size_t>(n)], motion, odometry, field);
  }
  (void)field.update();
  const Judged judged = judge(benchmark.scene, field);
  context.options.observer.say(request.scans.scene +
                               (motion == Motion::None      ? " without motion"
                                : motion == Motion::Removed ? " with motion removed"
                                                            : " with motion ignored") +
                               ": " + std::to_string(judged.figures.points()) + " points");
  return judged;
}

}  // namespace

void makeMotionTable(TableContext& context) {
  for (const char* scene : {"torus", "sphere_a", "box"}) {
    const RunRequest request = productRun(scene, kMotionVoxel_m);
    const sim::BenchmarkScene benchmark = sim::benchmarkScene(scene, kMotionVoxel_m);
    double still_f1 = 0;
    for (const auto& [motion, variant] : {std::pair(Motion::None, "the sensor stands still during a scan"),
                                          {Motion::Removed, "2 m/s, motion within the scan removed"},
                                          {Motion::Ignored, "2 m/s, motion within the scan ignored"}}) {
      TableRow row;
      row.table = "motion";
      row.scene = scene;
      row.method = "product";
      row.variant = variant;
      row.voxel_m = kMotionVoxel_m;
      const Judged judged = fly(context, benchmark, request, motion);
      row.figures = judged.figures;
      if (motion == Motion::None) still_f1 = row.figures.f1();
      row.more = {{"f1_off_still", row.figures.f1() - still_f1}, {"off_surface_mm", 1e3 * judged.off_surface_m}};
      if (motion == Motion::Removed) row.must_hold = std::abs(row.figures.f1() - still_f1) <= kMostF1;
      context.rows.push_back(row);
    }
  }
}

}  // namespace accessvdb::eval
