// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A drone that flies around known objects while it scans, heard live: raw clouds and registered ones, both with times
/// of points, are as good as those of a sensor that stands still during each scan, against exact ground truth.
///
/// ACCESSVDB_LIVE_MOTION_VOXEL_MM=2 makes the long runs of docs/live.md.
#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "accessvdb/live_session.h"
#include "eval/collision_field.h"
#include "eval/confusion.h"
#include "eval/ground_truth.h"
#include "eval/scene_run.h"
#include "io/poses/pose_matching.h"
#include "sim/pine.h"
#include "sim/scene_catalogue.h"
#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

constexpr double kPeriod_s = 0.1;
constexpr std::int64_t kFirst_ns = 1'700'000'000'000'000'000;
/// A scan may be this far from the figures of one without motion.
constexpr double kMostF1 = 0.5;

enum class Sent { Still, Raw, Registered, RawWithoutTimes };

struct Flight {
  sim::Scene scene;
  sim::Helix path;
  int frames = 0;
  std::string tool;
  FieldParams params;
};

Flight flightAround(const std::string& name) {
  const char* given = std::getenv("ACCESSVDB_LIVE_MOTION_VOXEL_MM");
  const double voxel_m = given != nullptr ? std::atof(given) * 1e-3 : 0.005;
  Flight flight;
  if (name != "pine") {
    const RunRequest request = productRun(name, voxel_m);
    const sim::BenchmarkScene benchmark = sim::benchmarkScene(name, voxel_m);
    flight = {benchmark.scene, benchmark.path, given != nullptr ? benchmark.frames : 24, request.tool, request.params};
  } else {
    constexpr double kHeight_m = 4;
    sim::PineParams pine;
    pine.height_m = kHeight_m;
    flight.scene = sim::makePine(pine);
    flight.path.centre_W = flight.scene.centre_W;
    flight.path.radius_m = 2.5;
    flight.path.height_begin_m = 1 - flight.scene.centre_W.z();
    flight.path.height_end_m = kHeight_m - flight.scene.centre_W.z();
    flight.frames = given != nullptr ? 120 : 24;
    flight.tool = "builtin:pruner";
    flight.params = productRun("pine", 4 * voxel_m).params;
  }
  flight.params.backend = BackendKind::Cpu;
  return flight;
}

/// The path, flown at a speed with as many scans.
sim::Trajectory flown(const Flight& flight, double speed_m_s) {
  sim::Helix path = flight.path;
  path.azimuth_end_rad = path.azimuth_begin_rad + speed_m_s * kPeriod_s * flight.frames / path.radius_m;
  path.sweeps = 1;
  return sim::helix(path, flight.frames + 1);
}

Eigen::Isometry3d poseAt(const sim::Trajectory& flown, double scans) {
  const auto n = std::min(static_cast<std::size_t>(scans), flown.size() - 2);
  return io::interpolateBetween(flown[n], flown[n + 1], scans - static_cast<double>(n));
}

std::int64_t stampOf(double scans) {
  return kFirst_ns + static_cast<std::int64_t>(std::llround(1e9 * kPeriod_s * scans));
}

LiveScan sentAs(Sent sent, const sim::SimulatedFrame& frame, const sim::Trajectory& flown, int n) {
  LiveScan scan;
  scan.stamp_ns = stampOf(n);
  scan.frame = "lidar";
  scan.points = frame.points_S;
  if (sent == Sent::Still || sent == Sent::RawWithoutTimes) return scan;
  scan.times.assign(frame.times_ns.begin(), frame.times_ns.end());
  scan.time_unit_s = 1e-9;
  if (sent == Sent::Raw) return scan;
  scan.frame = "odom";
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const Eigen::Isometry3d T_W_S = poseAt(flown, n + 1e-9 * frame.times_ns[i] / kPeriod_s);
    // Who registers clouds leaves out what is no return.
    scan.points[i] = frame.points_S[i].isZero(0) ? Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN())
                                                 : (T_W_S * frame.points_S[i].cast<double>()).cast<float>().eval();
  }
  return scan;
}

Confusion judge(const Flight& flight, const AccessibilityField& field) {
  std::vector<Eigen::Vector3d> positions_W, normals_W;
  std::vector<std::uint8_t> found;
  Eigen::AlignedBox3d box_W;
  for (const SurfacePoint& point : field.snapshot().points) {
    if (point.confidence < static_cast<float>(field.params().scoring.confidence_min)) continue;
    positions_W.push_back(point.position_W);
    normals_W.emplace_back(point.normal_W.cast<double>());
    found.push_back(point.label == PointLabel::Accessible ? 1 : 0);
    box_W.extend(point.position_W);
  }
  const TruthOptions options = truthOptions(field.params());
  const auto collisions =
      std::make_shared<const CollisionField>(flight.scene.distance, box_W, 2 * options.collision_distance_m);
  return compare(GroundTruth(collisions, field.tool(), options).accessible(positions_W, normals_W), found);
}

Confusion fly(const Flight& flight, Sent sent, double speed_m_s) {
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.frame_period_s = kPeriod_s;
  model.moves = sent != Sent::Still;
  const sim::Trajectory flown_path = flown(flight, speed_m_s);
  sim::Trajectory stations = flown_path;
  if (!model.moves) stations.pop_back();
  const sim::Simulator simulator(flight.scene, model, stations, 1);
  LiveSession session(ToolGeometry::builtin(flight.tool), flight.params);
  constexpr int kAtOnce = 8, kPosesEach = 20;  // odometry at 200 Hz
  std::vector<sim::SimulatedFrame> frames(kAtOnce);
  for (int begin = 0; begin < simulator.frames(); begin += kAtOnce) {
    const int count = std::min(kAtOnce, simulator.frames() - begin);
    tbb::parallel_for(0, count, [&](int n) { frames[static_cast<std::size_t>(n)] = simulator.frame(begin + n); });
    for (int n = 0; n < count; ++n) {
      for (int i = 0; i <= kPosesEach; ++i) {
        const double scans = begin + n + static_cast<double>(i) / kPosesEach;
        const Eigen::Isometry3d T_W_S = poseAt(flown_path, scans);
        if (i > 0 || begin + n == 0)
          session.addPose({stampOf(scans), T_W_S.translation(), Eigen::Quaterniond(T_W_S.linear()), "odom"});
      }
      session.addScan(sentAs(sent, frames[static_cast<std::size_t>(n)], flown_path, begin + n));
    }
    while (session.step()) {
    }
  }
  session.endOfPoses();
  while (session.step()) {
  }
  const LiveStatus status = session.status();
  EXPECT_EQ(status.taken, static_cast<std::uint64_t>(flight.frames));
  EXPECT_EQ(status.by_times, sent == Sent::Raw || sent == Sent::Registered ? status.taken : 0U);
  return judge(flight, session.field());
}

class LiveMotion : public testing::TestWithParam<const char*> {};

TEST_P(LiveMotion, IsRemovedAsIfThereWereNone) {
  const Flight flight = flightAround(GetParam());
  const double still = fly(flight, Sent::Still, 2).f1();
  const double raw = fly(flight, Sent::Raw, 2).f1(), fast = fly(flight, Sent::Registered, 6).f1();
  const double still_fast = fly(flight, Sent::Still, 6).f1(), ignored = fly(flight, Sent::RawWithoutTimes, 2).f1();
  std::printf(
      "%s, voxel %g mm: F1 %.3f still on the path of 2 m/s, %.3f raw with times, %.3f raw without; %.3f still on the "
      "path of 6 m/s, %.3f registered with times\n",
      GetParam(), 1e3 * flight.params.tsdf.voxel_size_m, still, raw, ignored, still_fast, fast);
  EXPECT_GT(still, 85);
  EXPECT_NEAR(raw, still, kMostF1);
  EXPECT_NEAR(fast, still_fast, kMostF1);
  EXPECT_LT(ignored, still - 2) << "the flight would be no test";
}

INSTANTIATE_TEST_SUITE_P(Scenes, LiveMotion, testing::Values("box", "torus", "pine"),
                         [](const auto& scene) { return std::string(scene.param); });

}  // namespace
}  // namespace accessvdb::eval
