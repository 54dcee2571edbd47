// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Batch queries to a map of a walk past trees: positions, and links of an arm, per second. Field and queries are made
/// once; queries are made in calls of 2^20 positions, in random order.
#include <benchmark/benchmark.h>
#include <tbb/global_control.h>

#include <cmath>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/batch_query.h"
#include "sample_scans/random_stream.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb {
namespace {

constexpr std::size_t kPositions = std::size_t{1} << 20;
constexpr std::size_t kCapsules = std::size_t{1} << 13;

struct World {
  World()
      : field(ToolGeometry::builtin("builtin:pencil"), [] {
          FieldParams params;
          params.tsdf.voxel_size_m = 0.02;
          params.backend = BackendKind::Cpu;
          return params;
        }()) {
    const samples::WalkGenerator walk({.frames = 40, .max_range_m = 12});
    for (int frame = 0; frame < walk.frames(); ++frame) {
      const samples::WalkFrame scan = walk.frame(frame);
      field.integrateScan(scan.points_S, scan.T_W_S);
    }
    field.update();
    snapshot = field.snapshot();
  }
  AccessibilityField field;
  FieldSnapshot snapshot;
};

const World& world() {
  static const World made;
  return made;
}

double symmetric(samples::RandomStream& random) { return 2 * random.uniform() - 1; }

/// Positions within `off_m` (per axis) of a surface point.
std::vector<Eigen::Vector3d> nearSurface(const World& world, double off_m) {
  samples::RandomStream random(7);
  std::vector<Eigen::Vector3d> points_W(kPositions);
  for (auto& p_W : points_W) {
    const auto n = static_cast<std::size_t>(random.uniform() * static_cast<double>(world.snapshot.points.size()));
    p_W = world.snapshot.points[n].position_W;
    for (int axis = 0; axis < 3; ++axis) p_W[axis] += off_m * symmetric(random);
  }
  return points_W;
}

/// Along straight paths of 1 m that begin near a surface, one position per centimetre: typical for a planner.
std::vector<Eigen::Vector3d> alongWays(const World& world) {
  std::vector<Eigen::Vector3d> points_W;
  samples::RandomStream random(10);
  for (const Eigen::Vector3d& start_W : nearSurface(world, 0.5)) {
    const Eigen::Vector3d towards =
        Eigen::Vector3d(symmetric(random), symmetric(random), symmetric(random)).normalized();
    for (int step = 0; step < 100 && points_W.size() < kPositions; ++step) {
      points_W.emplace_back(start_W + 0.01 * step * towards);
    }
  }
  return points_W;
}

/// Positions anywhere in the box around the points.
std::vector<Eigen::Vector3d> anywhere(const World& world) {
  Eigen::Vector3d low = world.snapshot.points[0].position_W, high = low;
  for (const SurfacePoint& point : world.snapshot.points) {
    low = low.cwiseMin(point.position_W);
    high = high.cwiseMax(point.position_W);
  }
  samples::RandomStream random(8);
  std::vector<Eigen::Vector3d> points_W(kPositions);
  for (auto& p_W : points_W) {
    for (int axis = 0; axis < 3; ++axis) p_W[axis] = low[axis] + (high[axis] - low[axis]) * random.uniform();
  }
  return points_W;
}

void count(benchmark::State& state, const World& world, const std::vector<PointAnswer>& answers) {
  std::size_t with_point = 0, observed = 0;
  for (const PointAnswer& answer : answers) {
    with_point += answer.point_id != kNoPoint;
    observed += answer.weight > 0;
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(answers.size()));
  state.counters["surface_points"] = static_cast<double>(world.snapshot.points.size());
  state.counters["with_point_percent"] = 100.0 * static_cast<double>(with_point) / static_cast<double>(answers.size());
  state.counters["observed_percent"] = 100.0 * static_cast<double>(observed) / static_cast<double>(answers.size());
}

void points(benchmark::State& state, const World& world, const std::vector<Eigen::Vector3d>& points_W) {
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(0)));
  const BatchQuery query = world.field.batchQuery();
  std::vector<PointAnswer> answers(points_W.size());
  for (auto _ : state) query.at(points_W, answers);
  count(state, world, answers);
}

/// Args: threads, largest distance from a surface point in mm; 0 = at the points themselves.
void positionsNearSurface(benchmark::State& state) {
  const World& here = world();
  points(state, here, nearSurface(here, 1e-3 * static_cast<double>(state.range(1))));
}
BENCHMARK(positionsNearSurface)
    ->ArgNames({"threads", "off_mm"})
    ->ArgsProduct({{1, 2}, {0, 50, 200}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

void positionsAnywhere(benchmark::State& state) {
  const World& here = world();
  points(state, here, anywhere(here));
}
BENCHMARK(positionsAnywhere)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

void positionsAlongWays(benchmark::State& state) { points(state, world(), alongWays(world())); }
BENCHMARK(positionsAlongWays)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// Args: threads, radius in mm. Links of 0.3 m that begin near a surface.
void links(benchmark::State& state) {
  const World& here = world();
  const std::vector<Eigen::Vector3d> starts_W = nearSurface(here, 0.3);
  samples::RandomStream random(9);
  std::vector<CapsuleQuery> capsules(kCapsules);
  for (std::size_t n = 0; n < capsules.size(); ++n) {
    const Eigen::Vector3d towards(symmetric(random), symmetric(random), symmetric(random));
    capsules[n] = {starts_W[n], starts_W[n] + 0.3 * towards.normalized(), 1e-3 * static_cast<double>(state.range(1))};
  }
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(0)));
  const BatchQuery query = here.field.batchQuery();
  std::vector<CapsuleAnswer> answers(capsules.size());
  for (auto _ : state) query.along(capsules, answers);
  std::size_t collisions = 0;
  for (const CapsuleAnswer& answer : answers) collisions += answer.collision;
  state.SetItemsProcessed(static_cast<std::int64_t>(state.iterations()) * static_cast<std::int64_t>(answers.size()));
  state.counters["collision_percent"] = 100.0 * static_cast<double>(collisions) / static_cast<double>(answers.size());
}
BENCHMARK(links)
    ->ArgNames({"threads", "radius_mm"})
    ->ArgsProduct({{1, 2}, {0, 30, 60}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace
}  // namespace accessvdb

BENCHMARK_MAIN();
