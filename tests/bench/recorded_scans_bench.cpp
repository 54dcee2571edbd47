// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Integration of the twelve BALM scans (0.9 M returns): millions of returns per second, by the wall clock and by CPU
/// time. Only integration is timed, not reading. Data: $ACCESSVDB_TEST_DATA, else
/// ../shared/data next to the repository; without it, the benchmark is skipped.
#include <benchmark/benchmark.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>

#include <cstdlib>
#include <ctime>
#include <filesystem>

#include "accessvdb/scan_io.h"
#include "tsdf/scan_integrator.h"

namespace accessvdb {
namespace {

struct LocalScan {
  std::vector<Eigen::Vector3f> p_L, q_L;
};

std::vector<LocalScan> readScans() {
  const char* data = std::getenv("ACCESSVDB_TEST_DATA");
  const std::filesystem::path root =
      data != nullptr ? std::filesystem::path(data) : std::filesystem::path(ACCESSVDB_SOURCE_DIR) / "../shared/data";
  io::ScanInputOptions options;
  options.scans = root / "scans_poses_balm";
  options.poses = options.scans / "alidarPose.csv";
  std::vector<LocalScan> scans;
  if (!std::filesystem::exists(options.poses)) return scans;
  io::ScanSequence sequence = io::ScanSequence::open(options);
  for (std::size_t n = 0; n < sequence.size(); ++n) {
    const io::ScanRecord record = sequence.read(n);
    LocalScan scan;
    scan.q_L.push_back(record.T_W_S.translation().cast<float>());
    for (const Eigen::Vector3f& p_S : record.points_S) {
      if (p_S.norm() > 0) scan.p_L.push_back((record.T_W_S * p_S.cast<double>()).cast<float>());
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

double processCpuSeconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Args: voxel size in mm, tau in mm, threads.
void recordedScans(benchmark::State& state) {
  static const std::vector<LocalScan> scans = readScans();
  if (scans.empty()) {
    state.SkipWithError("scans_poses_balm is not at hand");
    return;
  }
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(state.range(2)));
  TsdfParams params;
  params.voxel_size_m = 0.001 * static_cast<double>(state.range(0));
  params.truncation_distance_m = 0.001 * static_cast<double>(state.range(1));
  double returns = 0;
  const double cpu_start = processCpuSeconds();
  for ([[maybe_unused]] auto _ : state) {
    state.PauseTiming();
    openvdb::initialize();
    auto map = std::make_unique<internal::PackedMap>(params);
    map->setCollisionDistance(0.5f * static_cast<float>(params.voxel_size_m));
    internal::ScanIntegrator integrator(*map);
    state.ResumeTiming();
    for (const LocalScan& scan : scans) {
      integrator.integrate(scan.p_L, scan.q_L);
      returns += static_cast<double>(scan.p_L.size());
    }
    state.PauseTiming();
    map.reset();
    state.ResumeTiming();
  }
  state.counters["Mreturns_per_s"] = benchmark::Counter(returns * 1e-6, benchmark::Counter::kIsRate);
  state.counters["Mreturns_per_cpu_s"] = returns * 1e-6 / (processCpuSeconds() - cpu_start);
}
BENCHMARK(recordedScans)
    ->ArgNames({"voxel_mm", "tau_mm", "threads"})
    ->Args({50, 200, 1})
    ->Args({20, 100, 1})
    ->Args({10, 100, 1})
    ->Args({50, 200, 2})
    ->Args({20, 100, 2})
    ->Args({10, 100, 2})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime()
    ->MinTime(2.0);

}  // namespace
}  // namespace accessvdb

BENCHMARK_MAIN();
