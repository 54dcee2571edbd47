// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The host's work for the mirror, without a device: the changes of the flight of `accessvdb-lab bench --scene pine` go
/// into a mirror changed in place and into one whose arena takes batches, as a device does, and discards them.
///
/// Prints milliseconds per frame, wall-clock and processor time over all threads, over the last frames:
///   place    in place, total
///   stage    in batches, total; of which
///   locate   finding and adding leaves
///   bits     filling patches
///   nodes    links, masks and headers of added nodes
/// and where the memory went; with ACCESSVDB_BENCH_DISTANCES=1 also, for the mirror of distances,
///   d-place  in place
///   d-stage  in batches
/// Options by environment: ACCESSVDB_BENCH_FRAMES (120), ACCESSVDB_BENCH_TIMED (40, the last
/// ones), ACCESSVDB_BENCH_VOXEL_MM (10), ACCESSVDB_BENCH_THREADS (0 = all), ACCESSVDB_BENCH_SCANS (a file that keeps
/// the scans).
#include <tbb/task_arena.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/pine_flight.h"
#include "mirror/nanovdb_mirror.h"
#include "parity/staged_arena.h"
#include "tsdf/scan_integrator.h"
#include "vdb/standard_grids.h"

namespace accessvdb {
namespace {

using bench::environment;
using bench::Moment;

struct Row {
  std::vector<double> clock_ms, processor_ms;
  void add(const Moment& from, const Moment& to) {
    clock_ms.push_back(to.clock_ms - from.clock_ms);
    processor_ms.push_back(to.processor_ms - from.processor_ms);
  }
  static double quantile(std::vector<double> values, double q) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
  }
  void print(const char* name) const {
    std::printf("%-8s median %7.2f p95 %7.2f, processor median %7.2f p95 %7.2f ms\n", name, quantile(clock_ms, 0.5),
                quantile(clock_ms, 0.95), quantile(processor_ms, 0.5), quantile(processor_ms, 0.95));
  }
};

/// Records when the mirror goes from one phase to the next.
class TimedArena final : public kernels::MirrorArena {
 public:
  TimedArena() : staged_(kernels::HostArena::kDefaultReserveBytes, 8u << 20) { staged_.carries_out = false; }
  [[nodiscard]] void* base() const noexcept override { return staged_.base(); }
  void commit(std::uint64_t bytes) override { staged_.commit(bytes); }
  void write(std::uint64_t offset, const void* source, std::uint64_t bytes) override {
    note(located);
    staged_.write(offset, source, bytes);
  }
  kernels::StagedWrites stageWrites(std::size_t count, std::uint32_t bytes) override {
    note(located);
    return staged_.stageWrites(count, bytes);
  }
  kernels::StagedPatches stagePatches(std::size_t count, kernels::PatchKind kind) override {
    note(located);
    return staged_.stagePatches(count, kind);
  }
  void stageFills(std::span<const kernels::ArenaFill> fills) override {
    note(located);
    staged_.stageFills(fills);
  }
  void endPatches(std::size_t count, std::size_t words) override {
    staged_.endPatches(count, words);
    patched = Moment::now();
  }
  void flush() override { staged_.flush(); }
  [[nodiscard]] std::uint64_t reservedBytes() const noexcept override { return staged_.reservedBytes(); }
  [[nodiscard]] std::uint64_t committedBytes() const noexcept override { return staged_.committedBytes(); }

  Moment located, patched;

 private:
  static void note(Moment& moment) {
    if (moment.clock_ms == 0) moment = Moment::now();
  }
  testing::StagedArena staged_;
};

void run() {
  const int frames = environment("ACCESSVDB_BENCH_FRAMES", 120);
  const int timed = std::min(frames, environment("ACCESSVDB_BENCH_TIMED", 40));
  const double voxel_size_m = 1e-3 * environment("ACCESSVDB_BENCH_VOXEL_MM", 10);
  const auto scans = bench::flightFromEnvironment(frames);

  const FieldParams params = bench::flightParams(voxel_size_m);
  internal::PackedMap map(params.tsdf);
  map.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  internal::ScanIntegrator integrator(map);
  internal::NanoVdbMirror in_place(std::make_unique<kernels::HostArena>(), voxel_size_m);
  auto owned = std::make_unique<TimedArena>();
  TimedArena& arena = *owned;
  internal::NanoVdbMirror staged(std::move(owned), voxel_size_m);

  const bool with_distances = environment("ACCESSVDB_BENCH_DISTANCES", 0) != 0;
  integrator.noteDistances(with_distances);
  const internal::DistanceLeaves leaves = {map.distanceCode(), static_cast<float>(params.tsdf.truncation_distance_m)};
  constexpr auto kTiles = internal::DistanceMirror::kDefaultRootCapacity;
  internal::DistanceMirror distances_in_place(std::make_unique<kernels::HostArena>(), voxel_size_m, kTiles, leaves);
  auto forgets = std::make_unique<testing::StagedArena>(kernels::HostArena::kDefaultReserveBytes, 8u << 20);
  forgets->carries_out = false;
  internal::DistanceMirror distances_staged(std::move(forgets), voxel_size_m, kTiles, leaves);

  Row place, stage, locate, bits, nodes, distances_place, distances_stage;
  double changes = 0, added = 0, bytes = 0;
  double distance_leaves = 0, distances_added = 0, distance_bytes = 0, row_pairs = 0;
  for (int n = 0; n < frames; ++n) {
    const bench::FlightScan& scan = scans[static_cast<std::size_t>(n)];
    const internal::IntegrationResult result = integrator.integrate(scan.p_L, {&scan.q_L, 1});
    const Moment start = Moment::now();
    in_place.applyLists(result.changes);
    const Moment between = Moment::now();
    arena.located = arena.patched = {};
    staged.applyLists(result.changes);
    const Moment end = Moment::now();
    distances_in_place.applyLists(result.distances);
    const Moment distances_placed = Moment::now();
    distances_staged.applyLists(result.distances);
    const Moment distances_end = Moment::now();
    if (n < frames - timed) continue;
    distances_place.add(end, distances_placed);
    distances_stage.add(distances_placed, distances_end);
    for (const auto& part : result.distances) {
      distance_leaves += static_cast<double>(part.size()) / timed;
      for (const DistanceChange& change : part) row_pairs += double(std::popcount(change.row_pairs)) / timed;
    }
    distances_added += static_cast<double>(distances_staged.lastTraffic().leaves_added) / timed;
    distance_bytes += static_cast<double>(distances_staged.lastTraffic().bytes_written) / timed;
    place.add(start, between);
    stage.add(between, end);
    locate.add(between, arena.located);
    bits.add(arena.located, arena.patched);
    nodes.add(arena.patched, end);
    for (const auto& part : result.changes) changes += static_cast<double>(part.size()) / timed;
    added += static_cast<double>(staged.lastTraffic().leaves_added) / timed;
    bytes += static_cast<double>(staged.lastTraffic().bytes_written) / timed;
  }
  std::printf("a frame: %.0f changed leaves, %.0f of them new, %.0f bytes sent\n", changes, added, bytes);
  place.print("place");
  stage.print("stage");
  locate.print("locate");
  bits.print("bits");
  nodes.print("nodes");
  std::printf("%llu leaves; %.1f MB of nodes, %.1f MB on the host\n",
              static_cast<unsigned long long>(staged.leafCount()), 1e-6 * static_cast<double>(staged.usedBytes()),
              1e-6 * static_cast<double>(staged.hostBytes()));
  if (!with_distances) return;
  std::printf("distances, a frame: %.0f leaves, %.0f of them new, %.1f of 32 pairs of rows each, %.0f bytes sent\n",
              distance_leaves, distances_added, row_pairs / distance_leaves, distance_bytes);
  distances_place.print("d-place");
  distances_stage.print("d-stage");
  std::printf("%llu leaves; %.1f MB of nodes, %.1f MB on the host\n",
              static_cast<unsigned long long>(distances_staged.leafCount()),
              1e-6 * static_cast<double>(distances_staged.usedBytes()),
              1e-6 * static_cast<double>(distances_staged.hostBytes()));
}

}  // namespace
}  // namespace accessvdb

int main() {
  openvdb::initialize();
  const int threads = accessvdb::environment("ACCESSVDB_BENCH_THREADS", 0);
  tbb::task_arena arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
  arena.execute([] { accessvdb::run(); });
  return 0;
}
