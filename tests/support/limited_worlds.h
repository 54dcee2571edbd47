// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Random worlds for fields that reach a limit, and the property that they must keep: what is left out blocks.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/device_view.h"
#include "accessvdb/tool_spec.h"
#include "support/determinism_support.h"

namespace accessvdb::test {

/// ACCESSVDB_WORLDS: for long runs.
inline std::uint64_t worldCount(std::uint64_t standard) {
  const char* given = std::getenv("ACCESSVDB_WORLDS");
  return given != nullptr ? std::strtoull(given, nullptr, 10) : standard;
}

struct SeenBox {
  Eigen::Array3d low, high;
  int first_scan = 0, end_scan = 1000;

  /// How far along a ray the box begins; infinite if the ray misses it.
  [[nodiscard]] double entry(const Eigen::Array3d& from, const Eigen::Array3d& along) const {
    const Eigen::Array3d a = (low - from) / along, b = (high - from) / along;
    const double begin = a.min(b).maxCoeff(), end = a.max(b).minCoeff();
    return begin > 0 && begin <= end ? begin : std::numeric_limits<double>::infinity();
  }
};

/// Boxes that come and go before a wall, and a sensor that walks past and looks now here, now there.
struct LimitedWorld {
  /// Long enough for votes against what was watched, and for things to be gone by the evidence of rays.
  static bool isLong(std::uint64_t number) { return number % 4 == 0; }
  explicit LimitedWorld(std::uint64_t seed) : random(seed) {
    boxes.push_back({{2, -3, -2}, {2.2, 3, 2}});
    const int others = 2 + static_cast<int>(random() % 6);
    for (int n = 0; n < others; ++n) {
      const double nearest_m = random() % 2 == 0 ? 0.6 : 1.7;  // half of them close to the wall
      const Eigen::Array3d low(uniform(random, nearest_m, 1.95), uniform(random, -1.5, 1.5), uniform(random, -1, 1));
      const Eigen::Array3d size(uniform(random, 0.05, 0.4), uniform(random, 0.05, 0.6), uniform(random, 0.05, 0.9));
      const int first = static_cast<int>(random() % 16);
      boxes.push_back({low, low + size, first < 4 ? 0 : first, first + 4 + static_cast<int>(random() % 14)});
    }
    noise_m = random() % 2 == 0 ? 0.003 : 0.03;
    returns = (isLong(seed) ? 1500 : 150) + static_cast<int>(random() % 500);
  }

  Scan scan(int number) {
    Scan scan;
    const Eigen::Array3d from(uniform(random, -0.4, 0.1), uniform(random, -0.8, 0.8), uniform(random, -0.4, 0.4));
    scan.T_W_S.linear() = Eigen::AngleAxisd(uniform(random, -3, 3), Eigen::Vector3d::UnitZ()).toRotationMatrix();
    scan.T_W_S.translation() = from.matrix();
    const double y = uniform(random, -1, 1), z = uniform(random, -0.6, 0.6), spread = uniform(random, 0.2, 1);
    for (int n = 0; n < returns; ++n) {
      const Eigen::Array3d at(2, y + uniform(random, -spread, spread), z + uniform(random, -spread, spread));
      const Eigen::Array3d along = at - from;
      double nearest = std::numeric_limits<double>::infinity();
      for (const SeenBox& box : boxes) {
        if (number >= box.first_scan && number < box.end_scan) nearest = std::min(nearest, box.entry(from, along));
      }
      if (!std::isfinite(nearest)) continue;
      nearest += uniform(random, -noise_m, noise_m) / along.matrix().norm();
      scan.points_S.push_back((scan.T_W_S.inverse() * (from + nearest * along).matrix()).cast<float>());
    }
    return scan;
  }

  std::mt19937_64 random;
  std::vector<SeenBox> boxes;
  double noise_m = 0;
  int returns = 0;
};

/// A kind of field, by number.
inline FieldParams limitedWorldParams(std::uint64_t world) {
  FieldParams params;
  params.tsdf.voxel_size_m = world % 2 == 0 ? 0.05 : 0.08;
  params.tsdf.range_noise_m = 0.01;
  constexpr ChangeMode kModes[] = {ChangeMode::Off, ChangeMode::Block, ChangeMode::Full};
  params.change.mode = LimitedWorld::isLong(world) ? kModes[1 + world / 8 % 2] : kModes[world / 2 % 3];
  if (params.change.mode == ChangeMode::Full && world % 5 < 2) params.change.free_for_s = 0.5;
  params.approach.num_directions = 36;
  params.threads = 1;
  params.backend = BackendKind::Cpu;
  return params;
}

struct LimitCounts {
  std::size_t limited = 0, unlimited = 0, left_out = 0, steps = 0, gone = 0, voxels = 0;
};

/// The map's facts, too, around the points: what labels hide today, another tool would meet.
inline void expectFactsAmong(const AccessibilityField& limited, const AccessibilityField& unlimited,
                             std::mt19937_64& random, LimitCounts& counts) {
  const DeviceView few = limited.hostView(), all = unlimited.hostView();
  for (const SurfacePoint& point : unlimited.snapshot().points) {
    Eigen::Vector3d p_W = point.position_W;
    for (Eigen::Index axis = 0; axis < 3; ++axis) p_W[axis] += uniform(random, -0.3, 0.3);
    ASSERT_TRUE(!all.collides(p_W.data()) || few.collides(p_W.data())) << p_W.transpose();
    ASSERT_TRUE(!few.armFree(p_W.data()) || all.armFree(p_W.data())) << p_W.transpose();
    ++counts.voxels;
  }
}

/// Every accessible point of the limited field is one of the other.
inline void expectAmong(const AccessibilityField& limited, const AccessibilityField& unlimited, LimitCounts& counts) {
  const FieldSnapshot few = limited.snapshot(), all = unlimited.snapshot();
  ASSERT_EQ(few.origin_W, all.origin_W);
  std::size_t next = 0;  // the limited field has some of the points, in the same order
  for (const SurfacePoint& point : few.points) {
    while (next < all.points.size() && all.points[next].position_W != point.position_W) ++next;
    ASSERT_LT(next, all.points.size()) << "a point that the unlimited field lacks";
    const SurfacePoint& other = all.points[next];
    ASSERT_TRUE(point.label != PointLabel::Accessible || other.label == PointLabel::Accessible)
        << "point " << point.id << " at " << point.position_W.transpose() << ", unlimited: " << text(other);
  }
  counts.limited += few.count(PointLabel::Accessible);
  counts.unlimited += all.count(PointLabel::Accessible);
}

inline void fuse(AccessibilityField& field, const Scan& scan, int number) {
  field.integrateScan(scan.points_S, scan.T_W_S, 10 + 0.1 * number);
  field.update();
}

/// One world: a limit that is reached after some scan, with room for all, few or no voxels that are left out.
inline void expectContained(std::uint64_t number, BackendKind backend, LimitCounts& counts) {
  LimitedWorld world(number);
  const FieldParams params = limitedWorldParams(number);
  FieldParams limited_params = params;
  limited_params.backend = backend;
  std::vector<ToolSpec> tools = {{armTool(), params.approach.orientations, 0, "arm", 0}};
  if (number % 5 == 0) {
    tools.push_back({boxTool({0, -0.2f, -0.1f}, {0.5f, 0.2f, 0.1f}), params.approach.orientations, 0, "box", 3});
  }
  AccessibilityField unlimited(tools, params), limited(tools, limited_params);
  std::optional<AccessibilityField> twin;  // on the CPU
  if (backend != BackendKind::Cpu) twin.emplace(tools, params);
  const bool is_long = LimitedWorld::isLong(number);
  const int scans = is_long ? 32 : 12;
  const int full_after = 1 + static_cast<int>(number / 6 % 6) * (is_long ? 3 : 1);
  constexpr std::size_t kMost[] = {std::size_t{1} << 17, std::size_t{1} << 17, 12, 0};
  for (int n = 0; n < scans; ++n) {
    const Scan scan = world.scan(n);
    if (n == full_after) limited.stopGrowing(kMost[number / 36 % 4]);
    if (n == full_after && twin) twin->stopGrowing(kMost[number / 36 % 4]);
    const std::uint64_t leaves = limited.memoryUse().leaves;
    fuse(unlimited, scan, n);
    const FrameStats stats = limited.integrateScan(scan.points_S, scan.T_W_S, 10 + 0.1 * n);
    limited.update();
    counts.left_out += stats.left_out_returns;
    ++counts.steps;
    if (n >= full_after) {
      EXPECT_EQ(limited.memoryUse().leaves, leaves);
    }
    SCOPED_TRACE("scan " + std::to_string(n));
    expectAmong(limited, unlimited, counts);
    if (twin) {
      fuse(*twin, scan, n);
      const FieldSnapshot a = limited.snapshot(), b = twin->snapshot();
      ASSERT_EQ(a.points.size(), b.points.size());
      for (std::size_t m = 0; m < a.points.size(); ++m) {
        ASSERT_EQ(a.points[m].label, b.points[m].label) << m;
        ASSERT_TRUE(a.points[m].label != PointLabel::Accessible || sameVerdict(a.points[m], b.points[m])) << m;
      }
    }
    if (testing::Test::HasFatalFailure()) return;
    const bool keeps_voxels = number / 36 % 4 < 2;
    if (backend == BackendKind::Cpu && keeps_voxels && n % 4 == 3) {
      expectFactsAmong(limited, unlimited, world.random, counts);
    }
    if (testing::Test::HasFatalFailure()) return;
  }
  for (const SurfacePoint& point : unlimited.snapshot().points) counts.gone += point.reason == PointReason::Changed;
  const FieldSnapshot now = limited.snapshot(), scratch = limited.evaluateFromScratch();
  for (std::size_t n = 0; n < now.points.size(); ++n) ASSERT_EQ(now.points[n].label, scratch.points[n].label) << n;
}

}  // namespace accessvdb::test
