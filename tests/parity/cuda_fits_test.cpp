// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A tool at any pose: the GPU finds what the CPU finds, voxel by voxel.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/pose_query.h"
#include "parity/gpu_test.h"
#include "support/walk_generator.h"

namespace accessvdb::test {
namespace {

class FitsOnDevice : public GpuTest {
 protected:
  /// @param poses  at least 200
  static void expectEqual(const char* tool, double voxel_size_m, int frames, int poses) {
    WalkOptions options = shortWalk(frames, 6000);
    options.range_noise_m = WalkOptions().range_noise_m;
    options.seed = 9;
    const WalkGenerator walk(options);
    FieldParams params;
    params.tsdf.voxel_size_m = voxel_size_m;
    params.tsdf.clear_rays_m = 6;
    params.backend = BackendKind::Cpu;
    AccessibilityField cpu(ToolGeometry::builtin(tool), params);
    params.backend = BackendKind::Cuda;
    AccessibilityField gpu(ToolGeometry::builtin(tool), params);
    for (int n = 0; n < options.frames; ++n) {
      const auto scan = walk.frame(n);
      cpu.integrateScan(scan.points_S, scan.T_W_S);
      gpu.integrateScan(scan.points_S, scan.T_W_S);
      cpu.update();
      gpu.update();
    }
    const std::vector<SurfacePoint> points = cpu.snapshot().points;
    std::mt19937 random(1);
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    std::vector<Eigen::Isometry3d> T_WT;
    for (int n = 0; n < poses; ++n) {
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      pose.translation() = points[random() % points.size()].position_W +
                           0.3 * Eigen::Vector3d(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      const Eigen::Vector3d axis(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      pose.linear() = Eigen::AngleAxisd(uniform(0, 3), axis.normalized()).toRotationMatrix();
      T_WT.push_back(pose);
    }
    T_WT[7].linear() *= 2;
    const std::vector<FitAnswer> a = cpu.poseQuery().fits(T_WT), b = gpu.poseQuery().fits(T_WT);
    int differ = 0, free = 0, collide = 0, unknown = 0, invalid = 0;
    for (std::size_t n = 0; n < a.size(); ++n) {
      differ +=
          a[n].collisions != b[n].collisions || a[n].unknown_voxels != b[n].unknown_voxels || a[n].valid != b[n].valid
              ? 1
              : 0;
      free += a[n].free() ? 1 : 0;
      collide += a[n].collision() ? 1 : 0;
      unknown += a[n].unknown() ? 1 : 0;
      invalid += a[n].valid ? 0 : 1;
    }
    EXPECT_EQ(differ, 0) << tool << " " << voxel_size_m;
    EXPECT_EQ(invalid, 1);
    EXPECT_GT(collide, poses / 10);
    EXPECT_GT(unknown, poses / 10);
    for (std::size_t n = 0; n + 3 < 60; n += 3) {
      const std::span<const Eigen::Isometry3d> way(T_WT.data() + 10 + n, 3);
      for (const bool unknown_blocks : {false, true}) {
        const PathFitOptions of_way = {.unknown_blocks = unknown_blocks};
        const PathFitAnswer one = cpu.poseQuery().fitsAlong(way, of_way),
                            other = gpu.poseQuery().fitsAlong(way, of_way);
        EXPECT_EQ(one.valid, other.valid);
        EXPECT_EQ(one.collision, other.collision);
        EXPECT_EQ(one.unknown, other.unknown);
        EXPECT_TRUE(one.first_hit == other.first_hit || !one.collision);
        EXPECT_TRUE(one.fits_until == other.fits_until || (std::isnan(one.fits_until) && std::isnan(other.fits_until)));
      }
    }
    for (std::size_t n = 100; n < 140; ++n) {
      const FitAnswer one = cpu.poseQuery().fits({&T_WT[n], 1}, {.contact = true})[0],
                      other = gpu.poseQuery().fits({&T_WT[n], 1}, {.contact = true})[0];
      EXPECT_EQ(one.collisions, other.collisions);
      EXPECT_EQ(one.unknown_voxels, other.unknown_voxels);
    }
  }
};

TEST_F(FitsOnDevice, EqualThoseOfTheCpu) {
  for (const double voxel_size_m : {0.05, 0.02})
    for (const char* tool : {"builtin:pencil", "builtin:pruner"}) expectEqual(tool, voxel_size_m, 8, 100000);
}

/// For the tools that look at each access to memory.
TEST_F(FitsOnDevice, ShortRun) { expectEqual("builtin:pruner", 0.05, 2, 300); }

}  // namespace
}  // namespace accessvdb::test
