// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Poses of a tool per second, PoseQuery::fits(): the pruner at 20 mm near the surfaces of a walk past trees, turned at
/// random. ACCESSVDB_BENCH_CUDA=1: on a GPU. ACCESSVDB_BENCH_THREADS: of the CPU (all). ACCESSVDB_BENCH_POSES (100000).
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/pose_query.h"
#include "sample_scans/random_stream.h"
#include "sample_scans/walk_generator.h"

namespace {

int fromEnvironment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

}  // namespace

int main() {
  using namespace accessvdb;
  FieldParams params;
  params.tsdf.voxel_size_m = 0.02;
  params.tsdf.clear_rays_m = 20;
  params.backend = fromEnvironment("ACCESSVDB_BENCH_CUDA", 0) != 0 ? BackendKind::Cuda : BackendKind::Cpu;
  params.threads = fromEnvironment("ACCESSVDB_BENCH_THREADS", 0);
  AccessibilityField field(ToolGeometry::builtin("builtin:pruner"), params);
  const samples::WalkGenerator walk({.frames = 40, .max_range_m = 12});
  for (int frame = 0; frame < walk.frames(); ++frame) {
    const samples::WalkFrame scan = walk.frame(frame);
    field.integrateScan(scan.points_S, scan.T_W_S);
  }
  field.update();
  const std::vector<SurfacePoint> points = field.snapshot().points;
  samples::RandomStream random(3);
  std::vector<Eigen::Isometry3d> T_WT(static_cast<std::size_t>(fromEnvironment("ACCESSVDB_BENCH_POSES", 100000)));
  for (Eigen::Isometry3d& pose : T_WT) {
    pose.setIdentity();
    const auto n = static_cast<std::size_t>(random.uniform() * static_cast<double>(points.size()));
    const auto any = [&] { return 2 * random.uniform() - 1; };
    pose.translation() = points[n].position_W + 0.5 * Eigen::Vector3d(any(), any(), any());
    pose.linear() = Eigen::AngleAxisd(3.14 * random.uniform(), Eigen::Vector3d(any(), any(), any()).normalized())
                        .toRotationMatrix();
  }
  const PoseQuery query = field.poseQuery();
  std::vector<FitAnswer> answers(T_WT.size());
  query.fits(std::span(T_WT).first(1), std::span(answers).first(1));
  std::vector<double> per_second;
  for (int repeat = 0; repeat < 7; ++repeat) {
    const auto begin = std::chrono::steady_clock::now();
    query.fits(T_WT, answers);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    per_second.push_back(static_cast<double>(T_WT.size()) / seconds.count());
  }
  std::ranges::sort(per_second);
  const auto share = [&](auto&& is) {
    return 100.0 * static_cast<double>(std::ranges::count_if(answers, is)) / static_cast<double>(answers.size());
  };
  std::printf("%s: %.0f poses per second (median of 7, %.0f .. %.0f); %.1f %% free, %.1f %% collide, %.1f %% unknown\n",
              field.deviceName().c_str(), per_second[3], per_second.front(), per_second.back(),
              share([](const FitAnswer& a) { return a.free(); }),
              share([](const FitAnswer& a) { return a.collision(); }),
              share([](const FitAnswer& a) { return a.unknown(); }));
  return 0;
}
