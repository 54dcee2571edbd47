// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Hours on a closed path: what a session holds depends on the space that it knows, not on how long it runs.
///
/// By default each lap is like the one before. ACCESSVDB_LIVE_LAPS=120 ACCESSVDB_LIVE_RAYS=2000 ACCESSVDB_LIVE_SCANS=20
/// ACCESSVDB_LIVE_NOISE_MM=20 is the hour of docs/live.md: 120 laps of 30 s with 20 scans each and noise of 20 mm.
#include <gtest/gtest.h>

#include <unistd.h>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <random>

#include "live/live_stream.h"

namespace accessvdb::live_test {
namespace {

constexpr std::int64_t kLap_ns = 30'000'000'000;

int setting(const char* name, int otherwise) {
  const char* value = std::getenv(name);
  return value != nullptr ? std::atoi(value) : otherwise;
}

/// Distance along a ray to the inside of a room of 12 m x 12 m x 4 m or to one of eight poles in it.
double rangeOf(const Eigen::Vector3d& o, const Eigen::Vector3d& u) {
  double range = 1e9;
  const Eigen::Vector3d low(-6, -6, 0), high(6, 6, 4);
  for (int axis = 0; axis < 3; ++axis) {
    if (u[axis] > 1e-9) range = std::min(range, (high[axis] - o[axis]) / u[axis]);
    if (u[axis] < -1e-9) range = std::min(range, (low[axis] - o[axis]) / u[axis]);
  }
  constexpr double kRadius = 0.15;
  for (int pole = 0; pole < 8; ++pole) {
    const double angle = M_PI / 4 * pole, far = pole % 2 == 0 ? 4.5 : 1.2;
    const Eigen::Vector2d c = Eigen::Vector2d(far * std::cos(angle), far * std::sin(angle)) - o.head<2>();
    const double a = u.head<2>().squaredNorm(), b = u.head<2>().dot(c),
                 d = b * b - a * (c.squaredNorm() - kRadius * kRadius);
    if (d > 0 && b > 0) range = std::min(range, (b - std::sqrt(d)) / a);
  }
  return range;
}

struct Laps {
  int laps = setting("ACCESSVDB_LIVE_LAPS", 6), scans = setting("ACCESSVDB_LIVE_SCANS", 20),
      rays = setting("ACCESSVDB_LIVE_RAYS", 1500), noise_mm = setting("ACCESSVDB_LIVE_NOISE_MM", 0);
};

/// A scan from a circle of 3 m; the same directions in each lap, other noise.
Scan scanAt(const Laps& path, int step, int lap) {
  Scan scan;
  const int rays = path.rays;
  const double angle = 2 * M_PI * step / path.scans;
  scan.T_W_S.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  scan.T_W_S.translation() = Eigen::Vector3d(3 * std::cos(angle), 3 * std::sin(angle), 1.5);
  std::mt19937_64 random(static_cast<std::uint64_t>(lap) * 1000 + static_cast<std::uint64_t>(step));
  std::normal_distribution<double> noise(0, 1e-3 * path.noise_mm + 1e-12);
  for (int n = 0; n < rays; ++n) {  // a spiral over the sphere
    const double z = -0.6 + 1.2 * (n + 0.5) / rays, turn = 2.399963 * n + step, r = std::sqrt(1 - z * z);
    const Eigen::Vector3d u_S(r * std::cos(turn), r * std::sin(turn), z);
    const double range = rangeOf(scan.T_W_S.translation(), scan.T_W_S.linear() * u_S) + noise(random);
    scan.points_S.push_back((range * u_S).cast<float>());
  }
  return scan;
}

std::uint64_t residentBytes() {
  std::ifstream statm("/proc/self/statm");
  std::uint64_t all = 0, resident = 0;
  statm >> all >> resident;
  return resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

TEST(LiveClosedPath, MemoryStopsGrowingAfterThreeLaps) {
  const Laps path;
  const std::int64_t step_ns = kLap_ns / path.scans;
  LiveSession session(test::armTool(), coarseParams());
  std::vector<std::uint64_t> resident, held;
  double changed = 0;
  for (int lap = 0; lap < path.laps; ++lap) {
    for (int step = 0; step < path.scans; ++step) {
      const Scan scan = scanAt(path, step, lap);
      const std::int64_t stamp_ns = kFirst_ns + (std::int64_t{lap} * path.scans + step) * step_ns;
      session.addPose({stamp_ns, scan.T_W_S.translation(), Eigen::Quaterniond(scan.T_W_S.linear())});
      session.addScan({stamp_ns, scan.points_S});
      const auto taken = session.step();
      ASSERT_TRUE(taken);
      changed += static_cast<double>(taken->changed.size());
    }
    resident.push_back(residentBytes());
    held.push_back(session.status().memory_bytes);
    const LiveStatus status = session.status();
    std::printf("lap %d: resident %.1f MiB, field %.1f MiB, %llu points, latency p50 %.1f ms, p99 %.1f ms\n", lap + 1,
                static_cast<double>(resident.back()) / (1 << 20), static_cast<double>(held.back()) / (1 << 20),
                static_cast<unsigned long long>(status.surface_points), status.latency_p50_ms, status.latency_p99_ms);
    std::fflush(stdout);
  }
  expectAllAccountedFor(session.status());
  EXPECT_EQ(session.status().allDropped(), 0U);
  EXPECT_GT(changed, 0);
  // With noise, a return now and then is the first one in its voxel, and makes a point: ever fewer, but for many laps.
  const std::size_t settled = path.noise_mm == 0 ? 3 : resident.size() / 2;
  double worst_resident = 0, worst_held = 0;
  for (std::size_t lap = settled; lap < resident.size(); ++lap) {
    const auto growth = [lap](const std::vector<std::uint64_t>& bytes) {
      return static_cast<double>(bytes[lap]) / static_cast<double>(bytes[lap - 1]) - 1;
    };
    worst_resident = std::max(worst_resident, growth(resident));
    worst_held = std::max(worst_held, growth(held));
  }
  std::printf("largest growth per lap after lap %zu: resident %.3f %%, field %.3f %%\n", settled, 100 * worst_resident,
              100 * worst_held);
  EXPECT_LT(worst_held, 0.01);
#ifndef __SANITIZE_ADDRESS__  // which keeps what was freed
  // What the process holds otherwise comes and goes in huge pages of 2 MiB, a few of which may do so at any time. So it
  // is measured over all laps together.
  const double laps = static_cast<double>(resident.size() - settled), few_pages = 4 << 21;
  EXPECT_LT(static_cast<double>(resident.back()),
            static_cast<double>(resident[settled - 1]) * (1 + 0.01 * laps) + few_pages);
#endif
}

}  // namespace
}  // namespace accessvdb::live_test
