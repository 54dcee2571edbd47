// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How fast a field is saved and loaded (AccessibilityField::saveState, loadState), of rolling ground seen from above.
///
/// Prints the median, the least and the most over rounds that save, load, and compare what the loaded field saves.
/// Saving ends when the file is on the disk, loading starts with the file in the page cache. Options by environment:
/// ACCESSVDB_BENCH_POINTS (7000000), ACCESSVDB_BENCH_VOXEL_MM (10), ACCESSVDB_BENCH_ROUNDS (5), ACCESSVDB_BENCH_THREADS
/// (0 = all), TMPDIR for where the file goes.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/scan_io.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

int environment(const char* name, int fallback) {
  const char* value = std::getenv(name);
  return value == nullptr ? fallback : std::atoi(value);
}

double secondsSince(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

struct Spread {
  double median, least, most;
};
Spread spreadOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {values[values.size() / 2], values.front(), values.back()};
}

/// A return in each voxel column of square patches, each seen from above its middle.
AccessibilityField groundOf(std::size_t points, double voxel_m, int threads) {
  FieldParams params;
  params.tsdf.voxel_size_m = voxel_m;
  params.backend = BackendKind::Cpu;
  params.threads = threads;
  AccessibilityField field(ToolGeometry::builtin("builtin:pencil"), params);
  constexpr int kPatch = 150;  // returns a side
  const int side = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(points)) / kPatch));
  for (int patch = 0; patch < side * side; ++patch) {
    const int x0 = kPatch * (patch % side), y0 = kPatch * (patch / side);
    std::vector<Eigen::Vector3d> points_W;
    for (int n = 0; n < kPatch * kPatch; ++n) {
      const double x = voxel_m * (x0 + n % kPatch), y = voxel_m * (y0 + n / kPatch);
      points_W.emplace_back(x, y, 0.3 * std::sin(2 * x) * std::cos(1.5 * y));
    }
    const Eigen::Vector3d sensor_W(voxel_m * (x0 + kPatch / 2), voxel_m * (y0 + kPatch / 2), 2);
    field.integrateRays(points_W, std::vector{sensor_W});
  }
  return field;
}

int run() {
  const int threads = environment("ACCESSVDB_BENCH_THREADS", 0), rounds = environment("ACCESSVDB_BENCH_ROUNDS", 5);
  const fs::path file = fs::temp_directory_path() / "accessvdb_bench.avst", again = file.string() + ".again";
  std::optional<AccessibilityField> field =
      groundOf(static_cast<std::size_t>(environment("ACCESSVDB_BENCH_POINTS", 7'000'000)),
               0.001 * environment("ACCESSVDB_BENCH_VOXEL_MM", 10), threads);
  std::vector<double> saved_s, loaded_s;
  bool same = true;
  for (int round = 0; round < rounds; ++round) {
    const Clock::time_point save = Clock::now();
    field->saveState(file);
    saved_s.push_back(secondsSince(save));
    field.reset();  // one at a time in memory
    const Clock::time_point load = Clock::now();
    field = AccessibilityField::loadState(file, ToolGeometry::builtin("builtin:pencil"), BackendKind::Cpu, threads);
    loaded_s.push_back(secondsSince(load));
    if (round > 0) continue;
    field->saveState(again);
    same = io::sha256OfFile(file) == io::sha256OfFile(again);
    fs::remove(again);
  }
  const SavedState state = inspectState(file);
  const double megabytes = static_cast<double>(fs::file_size(file)) / 1e6;
  fs::remove(file);
  std::printf("%llu points, %llu leaves, %.0f MB\n", static_cast<unsigned long long>(state.points),
              static_cast<unsigned long long>(state.leaves), megabytes);
  for (const auto& [name, times] : {std::pair{"saved", saved_s}, {"loaded", loaded_s}}) {
    const auto [median, least, most] = spreadOf(times);
    std::printf("%-6s in %6.2f s (%.2f .. %.2f), %5.0f MB/s\n", name, median, least, most, megabytes / median);
  }
  std::printf("saved again: %s\n", same ? "the same bytes" : "OTHER BYTES");
  return same ? 0 : 1;
}

}  // namespace
}  // namespace accessvdb

int main() { return accessvdb::run(); }
