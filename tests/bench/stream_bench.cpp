// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The exact policy on a long stream: a generated walk through a forest, one update per scan.
///
/// Every 25 frames, a full evaluation of the map is made for comparison. Counters (means over the frames after the
/// first 50): tests per frame, tests of a full evaluation, their ratio in percent, milliseconds per stage.
///   accessvdb_bench_stream --benchmark_counters_tabular=true
#include <benchmark/benchmark.h>

#include <cstdlib>

#include "accessvdb/accessibility_field.h"
#include "support/walk_generator.h"

namespace accessvdb {
namespace {

int environment(const char* name, int fallback) {
  const char* value = std::getenv(name);
  return value == nullptr ? fallback : std::atoi(value);
}

/// Args: voxel size in mm; whether new things block.
void exactStream(benchmark::State& state) {
  test::WalkOptions options;
  options.frames = environment("ACCESSVDB_BENCH_FRAMES", 300);
  options.rays_per_frame = 20000;
  options.range_noise_m = 0.02;
  options.length_m = 0.1 * options.frames;
  const test::WalkGenerator walk(options);
  for ([[maybe_unused]] auto _ : state) {
    FieldParams params;
    params.tsdf.voxel_size_m = 0.001 * static_cast<double>(state.range(0));
    params.change.mode = state.range(1) != 0 ? ChangeMode::Block : ChangeMode::Off;
    AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
    double tests = 0, dirty = 0, integrate = 0, mirror = 0, update = 0, score = 0, full = 0, ratio = 0;
    int frames = 0, samples = 0;
    for (int frame = 0; frame < options.frames; ++frame) {
      const auto scan = walk.frame(frame);
      const FrameStats f = field.integrateScan(scan.points_S, scan.T_W_S);
      const UpdateStats u = field.update();
      if (frame < options.frames / 6) continue;
      ++frames;
      tests += static_cast<double>(u.direction_tests);
      dirty += static_cast<double>(u.dirty_points);
      integrate += f.integrate_ms;
      mirror += f.mirror_ms;
      update += u.update_ms;
      score += u.score_ms;
      if (frame % 25 == 24) {
        std::uint64_t all = 0;
        benchmark::DoNotOptimize(field.evaluateFromScratch(&all));
        full += static_cast<double>(all);
        ratio += 100.0 * static_cast<double>(u.direction_tests) / static_cast<double>(all);
        ++samples;
      }
    }
    state.counters["points"] = static_cast<double>(field.snapshot().points.size());
    state.counters["tests"] = tests / frames;
    state.counters["full_tests"] = full / samples;
    state.counters["percent"] = ratio / samples;
    state.counters["dirty"] = dirty / frames;
    state.counters["integrate_ms"] = integrate / frames;
    state.counters["mirror_ms"] = mirror / frames;
    state.counters["update_ms"] = update / frames;
    state.counters["score_ms"] = score / frames;
  }
}
BENCHMARK(exactStream)

    ->ArgsProduct({{50, 20}, {0, 1}})
    ->Iterations(1)
    ->Unit(benchmark::kSecond);

}  // namespace
}  // namespace accessvdb

BENCHMARK_MAIN();
