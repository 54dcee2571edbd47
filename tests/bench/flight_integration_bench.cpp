// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Only fusion, on the flight of `accessvdb-lab bench --scene pine`: the parts of `integrate` of that verb.
///
/// Replays the same scans into fresh maps, round after round, and prints milliseconds per frame over the last frames:
///   fuse    ScanIntegrator::integrate, everything
///   points  PointStore::addReturns, the other part of the verb's `integrate`
///   age     where free space ages: what a scan's stamp makes unknown
/// and a hash of the map, which no optimisation may change. With ACCESSVDB_BENCH_DEVICE=1, the GPU fuses the same scans
/// into a map of its own, which is compared at the end: `device` is its time from the arrival of a scan until facts and
/// values are there, `call` that of the call that waits for it; with ACCESSVDB_BENCH_CACHE_MB it keeps so many of
/// values (0: all). Options by environment: ACCESSVDB_BENCH_FRAMES (120), ACCESSVDB_BENCH_TIMED (100, the last ones),
/// ACCESSVDB_BENCH_VOXEL_MM (10), ACCESSVDB_BENCH_THREADS (0 = all), ACCESSVDB_BENCH_BLOCK (1 = new things block; 0),
/// ACCESSVDB_BENCH_FREE_FOR_S (0 = for ever), ACCESSVDB_BENCH_ROUNDS (1), ACCESSVDB_BENCH_SCANS (a file that keeps the
/// scans, as simulating them takes longer).
#include <openvdb/openvdb.h>
#include <sys/resource.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <vector>

#include "accessvdb/program/memory_prediction.h"
#include "bench/pine_flight.h"
#include "field/new_thing_margin.h"
#include "launch/stopwatch.h"
#include "points/point_store.h"
#include "support/map_hash.h"
#include "tsdf/scan_integrator.h"
#if ACCESSVDB_BENCH_HAS_CUDA
#include "cuda/cuda_backend.h"
#include "parity/scan_on_device.h"
#endif

namespace accessvdb {
namespace {

using bench::environment;

/// User and system time of the process.
struct CpuTime {
  double user_s, system_s;
  static CpuTime now() {
    rusage usage = {};
    getrusage(RUSAGE_SELF, &usage);
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    return {seconds(usage.ru_utime), seconds(usage.ru_stime)};
  }
};

void printTimes(const char* name, std::vector<double> ms) {
  double mean = 0;
  for (const double value : ms) mean += value / static_cast<double>(ms.size());
  std::sort(ms.begin(), ms.end());
  std::printf("%-7s %8.2f mean %8.2f median %8.2f p95 ms\n", name, mean, ms[ms.size() / 2], ms[ms.size() * 95 / 100]);
}

#if ACCESSVDB_BENCH_HAS_CUDA
/// The same flight on the GPU.
class DeviceFlight {
 public:
  /// @param cache_bytes  0: no limit
  DeviceFlight(const internal::PackedMap& map, std::unique_ptr<internal::PackedMap> behind, std::uint64_t cache_bytes)
      : behind_(std::move(behind), 0), twin_(*backend_, map, behind_, cache_bytes) {}
  void fuse(const internal::PackedMap& map, const bench::FlightScan& scan, bool timed) {
    twin_.fuse(map, scan.p_L, {&scan.q_L, 1});
    if (!timed) return;
    kernel_ms_.push_back(static_cast<double>(twin_.milliseconds()));
    call_ms_.push_back(twin_.callMilliseconds());
  }
  void print(const internal::PackedMap& map, const internal::IntegrationResult& result) {
    printTimes("device", kernel_ms_);
    printTimes("call", call_ms_);
    const test::FusionDifferences found = twin_.compare(map, result);
    std::printf("device  %s: %llu differ; %.0f MB beside the grid\n", backend_->name().c_str(),
                static_cast<unsigned long long>(found.all()), 1e-6 * static_cast<double>(twin_.bytes()));
  }

 private:
  std::unique_ptr<kernels::CudaBackend> backend_ = kernels::makeCudaBackend(kernels::CudaOptions{});
  test::MapBehind behind_;
  test::ScanOnDevice twin_;
  std::vector<double> kernel_ms_, call_ms_;
};
#endif

std::unique_ptr<internal::PackedMap> makeMap(const FieldParams& params) {
  auto map = std::make_unique<internal::PackedMap>(params.tsdf);
  map->setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  if (environment("ACCESSVDB_BENCH_BLOCK", 0) != 0) {
    map->blockNewThings(static_cast<float>(internal::farFromSurfaces_m(params)));
  }
  return map;
}

void replay(const std::vector<bench::FlightScan>& scans, int timed, double voxel_size_m) {
  const FieldParams params = bench::flightParams(voxel_size_m);
  const std::unique_ptr<internal::PackedMap> made = makeMap(params);
  internal::PackedMap& map = *made;
  const int free_for_s = environment("ACCESSVDB_BENCH_FREE_FOR_S", 0);
  if (free_for_s > 0) map.ageFreeSpace(free_for_s);
  internal::ScanIntegrator integrator(map);
  integrator.hashFlips(environment("ACCESSVDB_BENCH_DEVICE", 0) != 0);
  kernels::DirectionTable level;
  level.xy.resize(2 * static_cast<std::size_t>(params.approach.num_directions));
  internal::PointStore points(params, level);
  std::vector<double> fuse_ms, points_ms, age_ms;
  double user_ms = 0, system_ms = 0, touched = 0, fresh = 0, updates = 0, passes = 0, changed = 0, aged = 0;
  std::uint64_t changes_hash = 0;
  const std::size_t first = scans.size() - static_cast<std::size_t>(timed);
#if ACCESSVDB_BENCH_HAS_CUDA
  std::unique_ptr<DeviceFlight> device;
  if (environment("ACCESSVDB_BENCH_DEVICE", 0) != 0) {
    const auto cache_bytes = static_cast<std::uint64_t>(environment("ACCESSVDB_BENCH_CACHE_MB", 0)) * 1000000;
    device = std::make_unique<DeviceFlight>(map, makeMap(params), cache_bytes);
  }
#endif
  for (std::size_t n = 0; n < scans.size(); ++n) {
    const bench::FlightScan& scan = scans[n];
    const kernels::Stopwatch ageing;
    std::vector<std::span<const LeafChange>> aged_parts;
    if (map.agesFreeSpace()) aged_parts = map.generations()->pass(map, bench::kFlightPeriod_s);
    const double ageing_ms = ageing.milliseconds();
#if ACCESSVDB_BENCH_HAS_CUDA
    if (device) device->fuse(map, scan, n >= first);
#endif
    const CpuTime before = CpuTime::now();
    const kernels::Stopwatch fusing;
    const internal::IntegrationResult result = integrator.integrate(scan.p_L, {&scan.q_L, 1});
    const double ms = fusing.milliseconds();
    const CpuTime after = CpuTime::now();
#if ACCESSVDB_BENCH_HAS_CUDA
    if (device && n + 1 == scans.size()) device->print(map, result);
#endif
    const kernels::Stopwatch adding;
    points.addReturns(scan.p_L, {&scan.q_L, 1});
    const double adding_ms = adding.milliseconds();
    for (const auto& part : result.changes) {
      for (const LeafChange& change : part) {  // their order is free
        std::uint64_t hash = 0xcbf29ce484222325ull;
        const auto add = [&hash](std::uint64_t value) { hash = (hash ^ value) * 0x100000001b3ull; };
        for (const std::int32_t origin : change.origin_ijk) add(static_cast<std::uint32_t>(origin));
        for (const LeafBits* bits :
             {&change.collides_on, &change.collides_off, &change.arm_free_on, &change.arm_free_off}) {
          for (const std::uint64_t word : *bits) add(word);
        }
        changes_hash += hash;
      }
    }
    if (n < first) continue;
    points_ms.push_back(adding_ms);
    age_ms.push_back(ageing_ms);
    for (const auto& part : aged_parts) aged += static_cast<double>(part.size()) / timed;
    fuse_ms.push_back(ms);
    user_ms += 1e3 * (after.user_s - before.user_s) / timed;
    system_ms += 1e3 * (after.system_s - before.system_s) / timed;
    touched += static_cast<double>(result.touched_leaves) / timed;
    fresh += static_cast<double>(result.new_leaves) / timed;
    updates += static_cast<double>(result.counts.distance_updates) / timed;
    passes += static_cast<double>(result.counts.cleared_updates) / timed;
    for (const auto& part : result.changes) changed += static_cast<double>(part.size()) / timed;
  }
  printTimes("fuse", fuse_ms);
  printTimes("points", points_ms);
  if (map.agesFreeSpace()) printTimes("age", age_ms);
  std::printf("cpu     %8.2f user %8.2f system ms a frame in fuse\n", user_ms, system_ms);
  std::printf("a frame: %.0f leaves touched, %.0f new, %.0f changed, %.2f M distance, %.2f M cleared updates\n",
              touched, fresh, changed, 1e-6 * updates, 1e-6 * passes);
  if (aged > 0) std::printf("a frame: %.0f leaves aged\n", aged);
  std::printf("map     %016llx changes %016llx, %llu leaves, %llu with values\n",
              static_cast<unsigned long long>(test::hashOf(map)), static_cast<unsigned long long>(changes_hash),
              static_cast<unsigned long long>(map.leaf_count),
              static_cast<unsigned long long>(map.allocated_leaf_count));
  std::printf("memory  %.0f MB, of them %.0f in %llu compact leaves; resident %.0f MB\n",
              1e-6 * static_cast<double>(map.memoryBytes()), 1e-6 * static_cast<double>(map.cold().bytes()),
              static_cast<unsigned long long>(map.cold().leaves()), 1e-6 * static_cast<double>(residentMemoryBytes()));
  std::fflush(stdout);
}

int run() {
  openvdb::initialize();
  const int frames = std::max(1, environment("ACCESSVDB_BENCH_FRAMES", 120));
  const int timed = std::clamp(environment("ACCESSVDB_BENCH_TIMED", 100), 1, frames);
  const int threads = environment("ACCESSVDB_BENCH_THREADS", 0);
  const int rounds = std::max(1, environment("ACCESSVDB_BENCH_ROUNDS", 1));
  const double voxel_size_m = 0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 10);
  const std::vector<bench::FlightScan> scans = bench::flightFromEnvironment(frames);
  tbb::task_arena arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
  for (int round = 0; round < rounds; ++round) {
    arena.execute([&] { replay(scans, timed, voxel_size_m); });
  }
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
