// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A field of a short walk past trees, far from the world's origin, for query tests.
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "sample_scans/random_stream.h"
#include "sample_scans/walk_generator.h"

namespace accessvdb::test {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

struct QueryWorld {
  static constexpr double kVoxel_m = 0.05;

  explicit QueryWorld(int threads = 0, BackendKind backend = BackendKind::Cpu, double collision_distance_m = 0,
                      bool mirror_distance = false)
      : walk({.frames = 6,
              .rays_per_frame = 6000,
              .range_noise_m = 0.01,
              .seed = 2,
              .max_range_m = 8,
              .offset_W = {512000.25, 5403000.5, 300.125}}),  // such as UTM
        field(ToolGeometry::builtin("builtin:pencil"),
              paramsOf(threads, backend, collision_distance_m, mirror_distance)) {
    for (int n = 0; n < 5; ++n) integrate(n);
    field.update();
  }
  static FieldParams paramsOf(int threads, BackendKind backend, double collision_distance_m = 0,
                              bool mirror_distance = false) {
    FieldParams params;
    params.tsdf.voxel_size_m = kVoxel_m;
    params.threads = threads;
    params.scoring.collision_distance_m = collision_distance_m;
    params.backend = backend;
    params.mirror_distance = mirror_distance;
    return params;
  }
  void integrate(int n) {
    const samples::WalkFrame frame = walk.frame(n);
    field.integrateScan(frame.points_S, frame.T_W_S);
  }
  [[nodiscard]] Eigen::Vector3d origin() const { return field.origin_W(); }
  /// The convention of types.h and OpenVDB: voxel i is centred at i * v, from the local origin. Only for positions that
  /// are not on a face, where rounding decides.
  [[nodiscard]] Eigen::Vector3i voxelOf(const Eigen::Vector3d& p_W) const {
    const Eigen::Vector3d x = (p_W - origin()) / kVoxel_m;
    return {int(std::floor(x.x() + 0.5)), int(std::floor(x.y() + 0.5)), int(std::floor(x.z() + 0.5))};
  }
  /// Random positions, each axis within `off_m` of a random surface point.
  [[nodiscard]] static std::vector<Eigen::Vector3d> nearSurface(const FieldSnapshot& snapshot, int count, double off_m,
                                                                std::uint64_t seed) {
    samples::RandomStream random(seed);
    std::vector<Eigen::Vector3d> points_W;
    for (int n = 0; n < count; ++n) {
      const auto id = static_cast<std::size_t>(random.uniform() * static_cast<double>(snapshot.points.size()));
      const Eigen::Vector3d off(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      points_W.emplace_back(snapshot.points[id].position_W + off_m * off);
    }
    return points_W;
  }

  samples::WalkGenerator walk;
  AccessibilityField field;
};

}  // namespace accessvdb::test
