// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxel of a position against whole numbers: coordinates and voxels in millimetres, where a face is exactly that.
#include "hostdev/position_voxel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

#include "hostdev/capsule.h"
#include "hostdev/voxel_scale.h"

namespace accessvdb::test {
namespace {

/// Voxels that divide a metre and others; those whose reciprocals float32 has and others.
constexpr std::array<int, 10> kVoxels_mm = {10, 20, 25, 30, 50, 70, 100, 125, 330, 1000};

/// floor(x / v + 1/2) in whole numbers: faces belong to the voxel above, on both sides of zero.
std::int64_t voxelInWholeNumbers(std::int64_t x_mm, std::int64_t voxel_mm) {
  const std::int64_t twice = 2 * x_mm + voxel_mm, edge = 2 * voxel_mm;
  return twice / edge - (twice % edge < 0 ? 1 : 0);
}

double inverseOf(int voxel_mm) { return kernels::VoxelScale(voxel_mm / 1000.0).inverse_float32; }

/// Every way to compute a voxel from a position that is stored.
void expectSameEverywhere(double x_m, double voxel_m, double origin_m) {
  const kernels::VoxelScale scale(voxel_m);
  const double voxel = kernels::voxelOfCoordinate(x_m, scale.inverse_float32);
  const float stored = kernels::storedCoordinate(x_m, scale.inverse_float32);
  const double in_file = origin_m + static_cast<double>(stored), read = in_file - origin_m;
  ASSERT_EQ(kernels::voxelIndex(stored, scale.inverse_float32), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(kernels::voxelOfCoordinate(stored, scale.inverse_float32), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(kernels::voxelOfCoordinate(read, scale.inverse_float32), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(kernels::voxelIndex(static_cast<float>(read), scale.inverse_float32), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(std::floor(read / voxel_m + 0.5), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(std::floor(read * (1 / voxel_m) + 0.5), voxel) << x_m << " " << voxel_m;
  ASSERT_EQ(std::round(read / voxel_m), voxel) << x_m << " " << voxel_m;
  // It moves by no more than it must.
  const double most_m = voxel_m * 1.5 * kernels::roundingAtFaces(x_m / voxel_m, 1 / voxel_m);
  ASSERT_LE(std::abs(static_cast<double>(stored) - x_m), most_m + 1e-7 * std::abs(x_m)) << x_m << " " << voxel_m;
}

TEST(PositionVoxel, IsThatOfWholeMillimetres) {
  std::mt19937_64 random(1);
  for (const int voxel_mm : kVoxels_mm) {
    // Farther out float32, in which the map is kept, does not tell a millimetre from a face.
    const std::int64_t far_mm = std::min<std::int64_t>(20000LL * voxel_mm, 3'000'000);
    for (int n = 0; n < 20000; ++n) {
      std::int64_t x_mm = n < 8000 ? n - 4000 : static_cast<std::int64_t>(random() % (2 * far_mm)) - far_mm;
      if (n % 3 == 0 && voxel_mm % 2 == 0) x_mm = x_mm / voxel_mm * voxel_mm + voxel_mm / 2;  // on a face
      // As read from a file, near the origin and far from it, in either direction.
      for (const std::int64_t origin_mm : {0LL, 4'700'000LL, 3'810'222'000LL, -3'810'222'000LL}) {
        const double origin_m = static_cast<double>(origin_mm) / 1000;
        const double x_m = static_cast<double>(origin_mm + x_mm) / 1000 - origin_m;
        ASSERT_EQ(kernels::voxelOfCoordinate(x_m, inverseOf(voxel_mm)), voxelInWholeNumbers(x_mm, voxel_mm))
            << x_mm << " mm in " << voxel_mm << " mm from " << origin_mm;
      }
      expectSameEverywhere(static_cast<double>(x_mm) / 1000, voxel_mm / 1000.0, 0);
      if (HasFatalFailure()) return;
    }
  }
}

/// What ScanGate does before: ray clouds come in steps of 2^-20 m.
TEST(PositionVoxel, StepsOfTheLocalFrameChangeNoFace) {
  for (const int voxel_mm : {10, 50, 70, 100}) {
    for (std::int64_t n = -20000; n <= 20000; ++n) {
      const std::int64_t x_mm = n * voxel_mm + voxel_mm / 2;
      const double stepped_m = std::round(static_cast<double>(x_mm) / 1000 * 0x1.0p20) * 0x1.0p-20;
      ASSERT_EQ(kernels::voxelOfCoordinate(stepped_m, inverseOf(voxel_mm)), voxelInWholeNumbers(x_mm, voxel_mm));
    }
  }
}

TEST(PositionVoxel, OfAStoredPositionIsTheSameEverywhere) {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const double voxel_m : {0.0005, 0.001, 0.01, 0.03, 0.0625, 1.0 / 3, 0.77, 10.0}) {
    for (int n = 0; n < 40000; ++n) {
      // Up to the farthest voxels, at all scales; a third a few float32 steps from a face.
      const double span = std::exp2(n % 20);
      double x_m = std::min(span, 1e6) * unit(random) * voxel_m;
      if (n % 3 == 0) {
        const double face_m = (std::floor(x_m / voxel_m) + 0.5) * voxel_m;
        x_m = face_m + unit(random) * 20 * (0x1.0p-24 * std::abs(face_m) + 0x1.0p-21);
      }
      for (const double origin_m : {0.0, 471'123.125, -3'810'222.3}) {
        expectSameEverywhere(x_m, voxel_m, std::round(origin_m / voxel_m) * voxel_m);
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST(PositionVoxel, OfCornersAndEdgesIsTheOneAbove) {
  const double inverse = inverseOf(50);
  for (const double x : {-18.675, -0.075, -0.025, 0.025, 0.075, 18.675}) {
    const double up = std::round(x / 0.05 + 0.5);
    const double corner[3] = {x, x, x}, edge[3] = {x, 0.001, x};
    EXPECT_EQ(kernels::voxelOfPosition(corner, inverse), kernels::Coord(int(up), int(up), int(up))) << x;
    EXPECT_EQ(kernels::voxelOfPosition(edge, inverse), kernels::Coord(int(up), 0, int(up))) << x;
  }
}

TEST(PositionVoxel, HasNoneForWhatIsNotANumber) {
  EXPECT_TRUE(std::isnan(kernels::voxelOfCoordinate(std::numeric_limits<double>::quiet_NaN(), 20)));
  EXPECT_FALSE(std::isfinite(kernels::voxelOfCoordinate(std::numeric_limits<double>::infinity(), 20)));
  EXPECT_TRUE(std::isnan(kernels::storedCoordinate(std::numeric_limits<double>::quiet_NaN(), 20)));
}

}  // namespace
}  // namespace accessvdb::test
