// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// How long a what-if takes (AccessibilityField::whatIf) on a state that `accessvdb map --checkpoint` saved:
///
///   accessvdb_bench_what_if STATE.avst [auto|cpu|cuda]
///
/// Cubes around points that the tool blocks, drawn at random, each grown until it holds so many observed voxels. Prints
/// the median, the least and the most over them, without the first call, which makes tables. Options by environment:
/// ACCESSVDB_BENCH_VOXELS (1000), ACCESSVDB_BENCH_ROUNDS (30), ACCESSVDB_BENCH_THREADS (0 = all), ACCESSVDB_BENCH_TOOL
/// (builtin:pruner), ACCESSVDB_SEED (1).
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/error.h"
#include "accessvdb/saved_state.h"
#include "accessvdb/what_if.h"

namespace accessvdb {
namespace {

using Clock = std::chrono::steady_clock;

int environment(const char* name, int fallback) {
  const char* value = std::getenv(name);
  return value == nullptr ? fallback : std::atoi(value);
}

double millisecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

void print(const char* what, std::vector<double> values) {
  std::sort(values.begin(), values.end());
  std::printf("%-28s median %10.1f  least %10.1f  most %10.1f\n", what, values[values.size() / 2], values.front(),
              values.back());
}

int run(const std::string& file, const std::string& device) {
  const char* tool_name = std::getenv("ACCESSVDB_BENCH_TOOL");
  const ToolGeometry tool = ToolGeometry::builtin(tool_name == nullptr ? "builtin:pruner" : tool_name);
  const BackendKind kind = device == "cuda"  ? BackendKind::Cuda
                           : device == "cpu" ? BackendKind::Cpu
                                             : BackendKind::Auto;
  AccessibilityField field = AccessibilityField::loadState(file, tool, kind, environment("ACCESSVDB_BENCH_THREADS", 0));
  while (!inspectState(file).updated && field.update().backlog > 0) {
  }
  const FieldSnapshot snapshot = field.snapshot();
  std::vector<Eigen::Vector3d> blocked_W;
  for (const SurfacePoint& point : snapshot.points) {
    if (point.reason == PointReason::Tool) blocked_W.push_back(point.position_W);
  }
  if (blocked_W.empty()) {
    std::printf("the tool blocks no point\n");
    return 1;
  }
  const auto wanted = static_cast<std::uint64_t>(environment("ACCESSVDB_BENCH_VOXELS", 1000));
  std::printf("%s: %zu points, %zu of them blocked by the tool, on %s\n", file.c_str(), snapshot.points.size(),
              blocked_W.size(), field.deviceName().c_str());
  std::mt19937_64 random(static_cast<std::uint64_t>(environment("ACCESSVDB_SEED", 1)));
  std::vector<double> all_ms, choose_ms, score_ms, voxels, colliding, tried, tests, opens;
  for (int round = -1; round < environment("ACCESSVDB_BENCH_ROUNDS", 30); ++round) {
    const Eigen::Vector3d centre_W = blocked_W[random() % blocked_W.size()];
    WhatIf what_if;
    double ms = 0;
    for (double half_voxels = 3; what_if.voxels < wanted && half_voxels < 100; half_voxels += 0.5) {
      const Eigen::Vector3d half = Eigen::Vector3d::Constant(half_voxels * field.params().tsdf.voxel_size_m);
      const std::vector<Region> regions = {Region::box(centre_W - half, centre_W + half)};
      const auto begin = Clock::now();
      what_if = field.whatIf(regions);
      ms = millisecondsSince(begin);
    }
    if (round < 0) continue;
    all_ms.push_back(ms);
    choose_ms.push_back(what_if.choose_ms);
    score_ms.push_back(what_if.score_ms);
    voxels.push_back(static_cast<double>(what_if.voxels));
    colliding.push_back(static_cast<double>(what_if.colliding_voxels));
    tried.push_back(static_cast<double>(what_if.points_tried));
    tests.push_back(static_cast<double>(what_if.direction_tests));
    opens.push_back(static_cast<double>(what_if.opens.size()));
  }
  print("voxels", voxels);
  print("colliding voxels", colliding);
  print("points tried", tried);
  print("directions tested", tests);
  print("points that open", opens);
  print("choosing [ms]", choose_ms);
  print("trying [ms]", score_ms);
  print("a call [ms]", all_ms);
  return 0;
}

}  // namespace
}  // namespace accessvdb

int main(int argc, char** argv) {
  if (argc < 2 || argc > 3) {
    std::fprintf(stderr, "usage: %s STATE.avst [auto|cpu|cuda]\n", argv[0]);
    return 2;
  }
  try {
    return accessvdb::run(argv[1], argc == 3 ? argv[2] : "auto");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
