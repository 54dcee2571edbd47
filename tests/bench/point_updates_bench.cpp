// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The host's work for points when a device chooses and scores (update/exact_on_device.cpp), without a device: a dummy
/// updater takes everything and does nothing. The flight is that of `accessvdb-lab bench --scene pine`.
///
/// Prints milliseconds per frame, wall-clock and processor time over all threads, over the last frames:
///   returns   PointStore::addReturns, which describes new and touched points, part of the verb's `integrate`
///   blocks    in UpdateScheduler::noteReturns: blocks with new points, part of the verb's `integrate`
///   points    in noteReturns: handing those descriptions over
///   reached   in noteReturns: the rest, which leaves the scan reached
///   flips     UpdateScheduler::noteChanges; what noteChange() noted during integration is not timed
///   crossed   in update(): which points became confident, and all weights, in order
///   rest      in update(): after the updater; concurrent work had finished earlier or is included
/// and order-independent hashes of what the updater was told, which no optimisation may change. Options by environment:
/// ACCESSVDB_BENCH_FRAMES (200), ACCESSVDB_BENCH_TIMED (40, the last ones), ACCESSVDB_BENCH_VOXEL_MM (10),
/// ACCESSVDB_BENCH_THREADS (0 = all), ACCESSVDB_BENCH_SCANS (a file that keeps the scans).
#include <openvdb/openvdb.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/pine_flight.h"
#include "field/point_weights.h"
#include "field/tools/scoring_setup.h"
#include "support/listening_backend.h"
#include "tsdf/scan_integrator.h"
#include "update/make_scheduler.h"

namespace accessvdb {
namespace {

using bench::environment;
using bench::Moment;

enum Phase { kReturns, kReached, kFlips, kBlocks, kPoints, kCrossed, kRest, kPhases };
constexpr const char* kPhaseNames[kPhases] = {"returns", "reached", "flips", "blocks", "points", "crossed", "rest"};

struct Phases {
  std::vector<double> clock_ms[kPhases], processor_ms[kPhases];
  Moment last = {};
  void begin() { last = Moment::now(); }
  void end(Phase phase) {
    const Moment now = Moment::now();
    clock_ms[phase].back() += now.clock_ms - last.clock_ms;
    processor_ms[phase].back() += now.processor_ms - last.processor_ms;
    last = Moment::now();
  }
  void nextFrame() {
    for (int n = 0; n < kPhases; ++n) clock_ms[n].push_back(0), processor_ms[n].push_back(0);
  }
};

struct Told {
  std::uint64_t deltas = 0, blocks = 0, block_ids = 0, crossed = 0, flips = 0;  ///< counts
  std::uint64_t deltas_hash = 0, weights_hash = 0, crossed_hash = 0, flips_hash = 0;
};

std::uint64_t mixed(std::uint64_t hash, std::uint64_t value) {
  hash = (hash ^ value) * 0x9e3779b97f4a7c15ull;
  return hash ^ hash >> 29;
}
std::uint64_t bitsOf(float value) { return __builtin_bit_cast(std::uint32_t, value == 0 ? 0.0f : value); }

class Listener final : public kernels::ExactUpdater {
 public:
  Listener(Phases& phases, Told& told) : phases_(phases), told_(told) {}
  void begin(const kernels::ScoringInput&, const kernels::FlipLists& lists) override {
    phases_.end(kCrossed);
    for (const std::span<const kernels::LeafFlips>& part : lists.leaves) {
      for (const kernels::LeafFlips& flips : part) {
        std::uint64_t hash = mixed(mixed(flips.kinds, flips.freed), mixed(flips.freed_heights, flips.freed_columns));
        for (const std::int32_t axis : flips.leaf) hash = mixed(hash, static_cast<std::uint32_t>(axis));
        told_.flips_hash += hash;
      }
      told_.flips += part.size();
    }
    phases_.begin();
  }
  [[nodiscard]] bool takesVoxels() const override { return true; }
  void findNeighbours() override {}
  void choose(const kernels::ScoringInput&) override {}
  void admit(const kernels::AdmitInput& input) override {
    phases_.end(input.deltas.empty() ? kBlocks : kPoints);
    for (const kernels::PointDelta& delta : input.deltas) {
      std::uint64_t hash = mixed(1, delta.id);
      for (int axis = 0; axis < 3; ++axis) {
        hash = mixed(hash, bitsOf(delta.position_L[axis]));
        hash = mixed(hash, bitsOf(delta.mean_L[axis]));
        hash = mixed(hash, delta.before_L[0] != delta.before_L[0] ? 1 : bitsOf(delta.before_L[axis]));
        hash = mixed(hash, bitsOf(delta.to_sensor_L[axis]));
      }
      for (const std::uint64_t word : delta.seen.word) hash = mixed(hash, word);
      told_.deltas_hash += hash;
    }
    told_.deltas += input.deltas.size();
    told_.blocks += input.blocks.size();
    told_.block_ids += input.block_ids.size();
    phases_.begin();
  }
  kernels::UpdateOutcome update(const kernels::ScoringInput&, const kernels::ConfidenceDelta& input) override {
    phases_.end(kCrossed);
    for (const kernels::PointWeight& point : input.weights) {
      told_.weights_hash += mixed(mixed(8, point.id), point.weight);
    }
    for (const kernels::PointWeight& point : input.crossed)
      told_.crossed_hash += mixed(mixed(7, point.id), point.weight);
    told_.crossed += input.crossed.size();
    kernels::UpdateOutcome outcome;
    outcome.evaluated = 1;  // like a device: flips count from now on
    phases_.begin();
    return outcome;
  }
  std::uint64_t bytes() const override { return 0; }

 private:
  Phases& phases_;
  Told& told_;
};

void print(const char* name, std::vector<double> clock_ms, const std::vector<double>& processor_ms) {
  double mean = 0, processor = 0;
  for (const double ms : clock_ms) mean += ms / static_cast<double>(clock_ms.size());
  for (const double ms : processor_ms) processor += ms / static_cast<double>(processor_ms.size());
  std::sort(clock_ms.begin(), clock_ms.end());
  std::printf("%-8s %8.2f mean %8.2f median %8.2f p95 %8.2f most ms   %8.2f ms of processors\n", name, mean,
              clock_ms[clock_ms.size() / 2], clock_ms[clock_ms.size() * 95 / 100], clock_ms.back(), processor);
}

void replay(const std::vector<bench::FlightScan>& scans, int timed, double voxel_size_m) {
  const FieldParams params = bench::flightParams(voxel_size_m);
  internal::PackedMap map(params.tsdf);
  map.setCollisionDistance(static_cast<float>(params.scoring.collision_distance_m));
  internal::ScanIntegrator integrator(map);
  Phases phases;
  Told told;
  test::ListeningBackend backend([&](const kernels::ExactTables&) { return std::make_unique<Listener>(phases, told); });
  const ToolGeometry tool = ToolGeometry::builtin("builtin:pencil");  // the smallest: nothing is scored
  const internal::ScoringSetup setup(tool, params, backend);
  internal::PointStore points(params, setup.directions());
  internal::PointScorer scorer(points, params, backend,
                               internal::makeMapReads(map, points, params.scoring.neighbourhood_weight));
  const auto scheduler = internal::makeScheduler(std::array{setup.scheduledFor(scorer)});
  integrator.visitChanges([&](std::size_t part, const LeafChange& change) { scheduler->noteChange(part, change); });
  Told first_told;
  for (std::size_t n = 0; n < scans.size(); ++n) {
    if (n + static_cast<std::size_t>(timed) == scans.size()) {
      phases = {};
      first_told = told;
    }
    const bench::FlightScan& scan = scans[n];
    const internal::IntegrationResult result = integrator.integrate(scan.p_L, {&scan.q_L, 1});
    phases.nextFrame();
    phases.begin();
    points.describeTouched(scheduler->needs().deltas);
    const internal::TouchedPoints& touched = points.addReturns(scan.p_L, {&scan.q_L, 1});
    phases.end(kReturns);
    scheduler->noteReturns(touched, scan.p_L, {&scan.q_L, 1});
    phases.end(kReached);
    scheduler->noteChanges(scan.p_L, {&scan.q_L, 1}, {result.changes, {}});
    phases.end(kFlips);
    scheduler->update(nullptr, 0);
    phases.end(kRest);
  }
  for (int phase = 0; phase < kPhases; ++phase) {
    print(kPhaseNames[phase], phases.clock_ms[phase], phases.processor_ms[phase]);
  }
  const auto each = [&](std::uint64_t now, std::uint64_t before) { return static_cast<double>(now - before) / timed; };
  std::printf("a frame: %.0f deltas, %.0f blocks with %.0f ids, %.0f crossed, %.0f flipped leaves\n",
              each(told.deltas, first_told.deltas), each(told.blocks, first_told.blocks),
              each(told.block_ids, first_told.block_ids), each(told.crossed, first_told.crossed),
              each(told.flips, first_told.flips));
  std::printf("points %u in %zu blocks, host bytes a point %.1f (store), %.1f (scheduler)\n", points.size(),
              points.index().blocks().size(), static_cast<double>(points.bytes()) / points.size(),
              static_cast<double>(scheduler->bytes()) / points.size());
  std::printf("hashes: deltas %016llx weights %016llx crossed %016llx flips %016llx\n",
              static_cast<unsigned long long>(told.deltas_hash), static_cast<unsigned long long>(told.weights_hash),
              static_cast<unsigned long long>(told.crossed_hash), static_cast<unsigned long long>(told.flips_hash));
}

int run() {
  openvdb::initialize();
  const int frames = std::max(1, environment("ACCESSVDB_BENCH_FRAMES", 200));
  const int timed = std::clamp(environment("ACCESSVDB_BENCH_TIMED", 40), 1, frames);
  const int threads = environment("ACCESSVDB_BENCH_THREADS", 0);
  const std::vector<bench::FlightScan> scans = bench::flightFromEnvironment(frames);
  tbb::task_arena arena(threads > 0 ? threads : static_cast<int>(tbb::task_arena::automatic));
  arena.execute([&] { replay(scans, timed, 0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 10)); });
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
