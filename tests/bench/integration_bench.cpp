// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Integration speed: frames of 20 000 returns on a walk past trees, and the cone kernel by itself.
///
/// Frame/<voxel mm>/<threads>/<new things block>: whole frames (cone, band, binning, new leaves) with tau = 0.1 m.
/// ConeKernel: the inner loop alone, on the (return, leaf) pairs of one frame. FullCube/<threads>: scans of a small
/// sphere at 1 mm with the paper's region and tau = 0.02 m, 68 921 voxels per return.
#include <benchmark/benchmark.h>
#include <sys/resource.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "sample_scans/walk_generator.h"
#include "tsdf/scan_integrator.h"

namespace {

using accessvdb::internal::IntegrationResult;
using accessvdb::internal::PackedMap;
using accessvdb::internal::ScanIntegrator;

constexpr std::size_t kReturnsPerFrame = 20000;
constexpr int kFrames = 20;
constexpr double kRangeNoise_m = 0.02;

struct Frame {
  std::vector<Eigen::Vector3f> p_L;
  Eigen::Vector3f q_L;
};

/// The sensor moves 0.1 m per frame; a third of the rays hit nothing, so more are cast.
const std::vector<Frame>& frames() {
  static const std::vector<Frame> made = [] {
    accessvdb::samples::WalkOptions options;
    options.frames = kFrames;
    options.rays_per_frame = 32000;
    options.range_noise_m = kRangeNoise_m;
    const accessvdb::samples::WalkGenerator walk(options);
    std::vector<Frame> list;
    for (int n = 0; n < walk.frames(); ++n) {
      const accessvdb::samples::WalkFrame scan = walk.frame(n);
      Frame& frame = list.emplace_back();
      frame.q_L = scan.T_W_S.translation().cast<float>();
      for (const Eigen::Vector3f& p_S : scan.points_S) {
        if (p_S.isZero(0) || frame.p_L.size() == kReturnsPerFrame) continue;
        frame.p_L.push_back((scan.T_W_S * p_S.cast<double>()).cast<float>());
      }
    }
    return list;
  }();
  return made;
}

double userSeconds() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec) + 1e-6 * static_cast<double>(usage.ru_utime.tv_usec);
}

accessvdb::TsdfParams paramsOf(double voxel_size_m) {
  accessvdb::TsdfParams params;
  params.voxel_size_m = voxel_size_m;
  params.truncation_distance_m = 0.1;
  return params;
}

/// One iteration is one frame; after the last frame of the walk a new map begins, untimed.
void frame(benchmark::State& state) {
  const double v = 1e-3 * static_cast<double>(state.range(0));
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(1)));
  const std::vector<Frame>& walk = frames();
  std::unique_ptr<PackedMap> map;
  std::unique_ptr<ScanIntegrator> integrator;
  std::size_t next = walk.size();
  double updates = 0, passes = 0, leaves = 0, new_leaves = 0, count = 0, user_s = 0;
  for (auto _ : state) {
    if (next == walk.size()) {
      state.PauseTiming();
      integrator.reset();
      map = std::make_unique<PackedMap>(paramsOf(v));
      map->setCollisionDistance(static_cast<float>(0.5 * v));
      if (state.range(2) != 0) map->blockNewThings(static_cast<float>(0.5 * v + std::max(2 * v, 3 * kRangeNoise_m)));
      integrator = std::make_unique<ScanIntegrator>(*map);
      next = 0;
      state.ResumeTiming();
    }
    const Frame& scan = walk[next++];
    const double begin_s = userSeconds();
    const IntegrationResult result = integrator->integrate(scan.p_L, {&scan.q_L, 1});
    user_s += userSeconds() - begin_s;
    updates += static_cast<double>(result.counts.distance_updates);
    passes += static_cast<double>(result.counts.cleared_updates);
    leaves += static_cast<double>(result.touched_leaves);
    new_leaves += static_cast<double>(result.new_leaves);
    count += 1;
  }
  state.counters["cone_updates_per_s"] = benchmark::Counter(updates, benchmark::Counter::kIsRate);
  state.counters["cone_per_frame"] = updates / count;
  state.counters["band_per_frame"] = passes / count;
  state.counters["leaves"] = leaves / count;
  state.counters["new_leaves"] = new_leaves / count;
  state.counters["user_ms"] = 1e3 * user_s / count;
  state.counters["voted_leaves"] = static_cast<double>(map->votedLeafCount());
}
BENCHMARK(frame)
    ->Name("Frame")
    ->ArgNames({"mm", "threads", "block"})
    ->ArgsProduct({{10, 20}, {1, 2}, {0, 1}})
    ->Iterations(2 * kFrames)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

/// The inner loop on the leaves around each return of a frame; range(0) picks the instruction set, best first.
void coneKernel(benchmark::State& state) {
  const auto list = accessvdb::internal::runnableLeafKernels();
  if (state.range(0) >= list.count) {
    state.SkipWithError("not on this machine");
    return;
  }
  const auto& kernels = *list.kernels[static_cast<std::size_t>(state.range(0))];
  state.SetLabel(kernels.name);
  accessvdb::internal::KernelConstants constants = {};
  constants.tau = 10;
  constants.cone_cos_squared = 0.95f * 0.95f;
  constants.clamp_high = 10;
  constants.sample_scale = 65535.0f / 10;
  std::vector<accessvdb::internal::ReturnInLeaf> rays;
  const Frame& scan = frames().front();
  accessvdb::internal::LeafSums sums;
  for (const Eigen::Vector3f& p_L : scan.p_L) {
    const Eigen::Vector3f p = p_L / 0.01f, e = scan.q_L / 0.01f - p, u = e.normalized();
    accessvdb::internal::ReturnInLeaf ray;
    for (int a = 0; a < 3; ++a) {
      const float base = std::floor(p[a] + 0.5f);
      ray.offset[static_cast<std::size_t>(a)] = p[a] - base;
      ray.to_sensor[static_cast<std::size_t>(a)] = u[a];
    }
    ray.range = e.norm();
    ray.box_x = {-10, 10};
    for (int n = 0; n < 64; ++n) {  // 4x4x4 leaves around the return
      for (int a = 0; a < 3; ++a) {
        const int base = static_cast<int>(std::floor(p[a] + 0.5f));
        ray.leaf[static_cast<std::size_t>(a)] = static_cast<float>(((base >> 3) - 2 + (n >> (2 * a) & 3)) * 8 - base);
      }
      if (kernels.add_double_cone(ray, constants, sums) != 0) rays.push_back(ray);
    }
  }
  double updates_a_round = 0;
  for (const auto& ray : rays) {
    sums = {};
    kernels.add_double_cone(ray, constants, sums);
    for (const std::uint32_t packed : sums.packed) updates_a_round += accessvdb::internal::LeafSums::samplesOf(packed);
  }
  for (auto _ : state) {
    for (const auto& ray : rays) benchmark::DoNotOptimize(kernels.add_double_cone(ray, constants, sums));
  }
  state.counters["pairs"] = static_cast<double>(rays.size());
  state.counters["cone_updates_per_s"] =
      benchmark::Counter(updates_a_round * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(coneKernel)->Name("ConeKernel")->Arg(0)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

/// One iteration is one scan of 300 returns from 0.6 m; a new map begins every 50 scans, untimed.
void fullCube(benchmark::State& state) {
  const tbb::global_control control(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(0)));
  constexpr int kScans = 50, kReturns = 300;
  constexpr double kRadius_m = 0.08, kDistance_m = 0.6;
  std::vector<Frame> scans(kScans);
  for (int n = 0; n < kScans; ++n) {
    const double angle = 2 * 3.141592653589793 * n / kScans;
    const Eigen::Vector3d towards(std::cos(angle), std::sin(angle), 0.3 * std::cos(3 * angle));
    const Eigen::Vector3d side = Eigen::Vector3d(-towards.y(), towards.x(), 0).normalized();
    const Eigen::Vector3d up = towards.cross(side).normalized();
    scans[static_cast<std::size_t>(n)].q_L = (kDistance_m * towards.normalized()).cast<float>();
    for (int m = 0; m < kReturns; ++m) {  // a spiral over the half that faces the sensor
      const double share = (m + 0.5) / kReturns, turn = 2.399963229728653 * (m + 17 * n);
      const double across = std::sqrt(share) * 0.98;
      const Eigen::Vector3d unit = across * (std::cos(turn) * side + std::sin(turn) * up) +
                                   std::sqrt(1 - across * across) * towards.normalized();
      scans[static_cast<std::size_t>(n)].p_L.push_back((kRadius_m * unit).cast<float>());
    }
  }
  accessvdb::TsdfParams params;
  params.voxel_size_m = 0.001;
  params.truncation_distance_m = 0.02;
  params.region = accessvdb::UpdateRegion::FullCube;
  params.cleared_radius_voxels = 0;
  params.cleared_begin_tau = 1;
  std::unique_ptr<PackedMap> map;
  std::unique_ptr<ScanIntegrator> integrator;
  std::size_t next = scans.size();
  double updates = 0, user_s = 0;
  for (auto _ : state) {
    if (next == scans.size()) {
      state.PauseTiming();
      integrator.reset();
      map = std::make_unique<PackedMap>(params);
      map->setCollisionDistance(0.0005f);
      integrator = std::make_unique<ScanIntegrator>(*map);
      next = 0;
      state.ResumeTiming();
    }
    const Frame& scan = scans[next++];
    const double begin_s = userSeconds();
    updates += static_cast<double>(integrator->integrate(scan.p_L, {&scan.q_L, 1}).counts.distance_updates);
    user_s += userSeconds() - begin_s;
  }
  state.counters["updates_per_s"] = benchmark::Counter(updates, benchmark::Counter::kIsRate);
  state.counters["updates_per_cpu_s"] = updates / user_s;
}
BENCHMARK(fullCube)
    ->Name("FullCube")
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->Iterations(100)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace

BENCHMARK_MAIN();
