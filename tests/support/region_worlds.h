// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fields of a wall with clutter before it, and regions of it to take out.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/region.h"
#include "support/determinism_support.h"
#include "support/scratch_folder.h"

namespace accessvdb::test {

/// ACCESSVDB_CHANGE_DEVICE=cuda: fields are on the GPU.
inline BackendKind changeBackend() { return backendNamedBy("ACCESSVDB_CHANGE_DEVICE"); }

inline FieldParams paramsFor(std::uint64_t seed) {
  FieldParams params;
  params.tsdf.voxel_size_m = seed % 2 == 0 ? 0.05 : 0.04;
  params.tsdf.range_noise_m = 0.01;
  params.tsdf.clamp_min_m = seed % 3 == 0 ? -0.02 : 0.0;
  params.backend = changeBackend();
  params.threads = 2;
  params.approach.num_directions = seed % 2 == 0 ? 36 : 64;
  if (seed % 4 == 3) {
    params.approach.orientations = OrientationSet::pitch(-30, 30, 30);
  }
  return params;
}

/// Every third is so short that its corridor ends outside of it.
inline ToolGeometry toolFor(std::uint64_t seed) {
  return seed % 3 == 1 ? boxTool({0.0f, -0.03f, -0.03f}, {0.2f, 0.04f, 0.06f}) : armTool();
}

inline AccessibilityField wallField(std::uint64_t seed) {
  AccessibilityField field(toolFor(seed), paramsFor(seed));
  for (const Scan& scan : wallScans(seed, 6, 1200)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  return field;
}
/// Few scans and a high bound: the confidence of many points hangs on single voxels.
inline AccessibilityField doubtfulField(std::uint64_t seed) {
  FieldParams params = paramsFor(seed);
  params.scoring.confidence_min = 0.6;
  AccessibilityField field(toolFor(seed), params);
  for (const Scan& scan : wallScans(seed, 3, 900)) field.integrateScan(scan.points_S, scan.T_W_S);
  field.update();
  return field;
}

inline AccessibilityField copyOf(const AccessibilityField& field, const ScratchFolder& folder) {
  field.saveState(folder / "copy.avst");
  return AccessibilityField::loadState(folder / "copy.avst", field.tool(), changeBackend(), 2);
}

/// A ball of triangles, outward.
inline Region ballRegion(const Eigen::Vector3d& centre, double radius_m) {
  constexpr int kRings = 12, kAround = 24;
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  for (int r = 0; r <= kRings; ++r) {
    for (int a = 0; a < kAround; ++a) {
      const double polar = r == 0 ? 0 : r == kRings ? M_PI : M_PI * r / kRings, yaw = 2 * M_PI * a / kAround;
      const double ring = r == 0 || r == kRings ? 0 : std::sin(polar);
      vertices.push_back(centre + radius_m * Eigen::Vector3d(ring * std::cos(yaw), ring * std::sin(yaw),
                                                             r == 0        ? 1
                                                             : r == kRings ? -1
                                                                           : std::cos(polar)));
    }
  }
  const auto at = [](int r, int a) { return static_cast<std::uint32_t>(r * kAround + a % kAround); };
  for (int r = 0; r < kRings; ++r) {
    for (int a = 0; a < kAround; ++a) {
      triangles.push_back({at(r, a), at(r + 1, a), at(r + 1, a + 1)});
      triangles.push_back({at(r, a), at(r + 1, a + 1), at(r, a + 1)});
    }
  }
  return Region::mesh(vertices, triangles);
}

/// Random boxes, balls and sets of points around the clutter of wallScans().
inline Region randomRegion(std::uint64_t seed, const FieldSnapshot& field) {
  std::mt19937_64 random(seed * 77 + 5);
  const Eigen::Vector3d centre(uniform(random, 1.0, 2.0), uniform(random, -0.2, 1.2), uniform(random, 0.5, 1.5));
  const Eigen::Vector3d half(uniform(random, 0.03, 0.3), uniform(random, 0.03, 0.3), uniform(random, 0.03, 0.5));
  if (seed % 3 == 0) return Region::box(centre - half, centre + half);
  if (seed % 3 == 1) return ballRegion(centre, uniform(random, 0.1, 0.35));
  std::vector<std::uint32_t> ids;
  for (const SurfacePoint& point : field.points) {
    if ((point.position_W - centre).norm() < 0.3) ids.push_back(point.id);
  }
  if (ids.empty()) ids.push_back(field.points.front().id);
  return Region::points(ids);
}

inline void expectExact(const AccessibilityField& field) {
  const FieldSnapshot now = field.snapshot(), scratch = field.evaluateFromScratch();
  ASSERT_EQ(now.points.size(), scratch.points.size());
  for (std::size_t n = 0; n < now.points.size(); ++n) {
    ASSERT_EQ(now.points[n].label, scratch.points[n].label) << n;
    if (now.points[n].label != PointLabel::Accessible) continue;
    ASSERT_EQ(now.points[n].score, scratch.points[n].score) << n;
    ASSERT_EQ(now.points[n].direction, scratch.points[n].direction) << n;
  }
}

}  // namespace accessvdb::test
