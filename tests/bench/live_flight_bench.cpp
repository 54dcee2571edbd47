// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How long the steps of a live session take along the flight of `accessvdb-lab bench`, from the arrival of a scan
/// until its changed points are there: a table with a row per 100 scans. Options by environment: ACCESSVDB_BENCH_FRAMES
/// (600), ACCESSVDB_BENCH_VOXEL_MM (50), ACCESSVDB_BENCH_CHANGE (full, as `live` has it; or block, off),
/// ACCESSVDB_BENCH_HZ (0 = a scan follows when the step before has ended), ACCESSVDB_BENCH_THREADS (0 = all),
/// ACCESSVDB_BENCH_CUDA (0; 1 = on the GPU).
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "accessvdb/live_session.h"
#include "accessvdb/tool_spec.h"
#include "bench/pine_flight.h"

namespace accessvdb {
namespace {

using bench::environment;

constexpr int kScansPerRow = 100, kScansAhead = 20;

ChangeMode changeFromEnvironment() {
  const char* const mode = std::getenv("ACCESSVDB_BENCH_CHANGE");
  if (mode == nullptr || std::string(mode) == "full") return ChangeMode::Full;
  return std::string(mode) == "block" ? ChangeMode::Block : ChangeMode::Off;
}

double at(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())))];
}

int run() {
  const int frames = environment("ACCESSVDB_BENCH_FRAMES", 600), hertz = environment("ACCESSVDB_BENCH_HZ", 0);
  FieldParams params = bench::flightParams(0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 50));
  params.backend = environment("ACCESSVDB_BENCH_CUDA", 0) != 0 ? BackendKind::Cuda : BackendKind::Cpu;
  params.change.mode = changeFromEnvironment();
  params.threads = environment("ACCESSVDB_BENCH_THREADS", 0);
  LiveSession session({{ToolGeometry::builtin("builtin:pruner"), OrientationSet::yaw()}}, params, {});
  const sim::Simulator simulator = bench::flightSimulator(frames);
  std::printf("%6s %10s | %9s %9s %9s | %9s %9s | %10s\n", "scans", "points", "median ms", "p95", "most", "fusing",
              "scoring", "changed");
  std::vector<double> step_ms, fusing_ms, scoring_ms;
  std::size_t changed = 0;
  using Clock = std::chrono::steady_clock;
  for (int begin = 0; begin < frames; begin += kScansAhead) {
    auto due = Clock::now();
    for (const sim::SimulatedFrame& frame :
         simulator.framesOfReturns(begin, std::min(frames, begin + kScansAhead), bench::kFlightReturns)) {
      const auto stamp_ns = static_cast<std::int64_t>(1e9 * (1 + frame.stamp_s));
      LiveScan scan;
      scan.stamp_ns = stamp_ns;
      scan.points = frame.points_S;
      if (hertz > 0) {
        if (step_ms.empty() || due < Clock::now()) due = std::max(due, Clock::now());
        std::this_thread::sleep_until(due);
        due += std::chrono::nanoseconds(1000000000 / hertz);
      }
      session.addPose({stamp_ns, frame.T_W_S.translation(), Eigen::Quaterniond(frame.T_W_S.linear())});
      session.addScan(std::move(scan));
      const auto step = session.step();
      if (!step) {
        std::fprintf(stderr, "a scan was not taken\n");
        return 1;
      }
      step_ms.push_back(step->latency_ms);
      fusing_ms.push_back(step->fused.integrate_ms + step->fused.mirror_ms);
      scoring_ms.push_back(step->scored.update_ms + step->scored.score_ms);
      changed += step->changed.size();
      if (step_ms.size() < kScansPerRow && step->number + 1 < static_cast<std::uint64_t>(frames)) continue;
      std::printf("%6llu %10llu | %9.1f %9.1f %9.1f | %9.1f %9.1f | %10zu\n",
                  static_cast<unsigned long long>(session.status().taken),
                  static_cast<unsigned long long>(session.status().surface_points), at(step_ms, 0.5), at(step_ms, 0.95),
                  at(step_ms, 1), at(fusing_ms, 0.5), at(scoring_ms, 0.5), changed / step_ms.size());
      std::fflush(stdout);
      step_ms.clear();
      fusing_ms.clear();
      scoring_ms.clear();
      changed = 0;
    }
  }
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
