// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "sim/understory.h"

#include <Eigen/Core>
#include <cmath>

#include "sim/angles.h"
#include "sim/counter_random.h"
#include "sim/pine_tessellation.h"

namespace accessvdb::sim {
namespace {

using Eigen::Vector3d;

constexpr double kGroundStep_m = 0.06;
constexpr double kChordError_m = 0.002;
constexpr double kPatchRadius_m = 1.5;
constexpr int kPlants = 14, kTwigs = 40;

/// Waves whose lengths divide the period: number of waves along x and y, and height.
struct Wave {
  int along_x, along_y;
  double height_m;
};
constexpr Wave kWaves[] = {{1, 1, 0.12},     {2, -1, 0.10},   {-1, 3, 0.06},   {5, 2, 0.04},
                           {-4, 7, 0.03},    {11, 6, 0.02},   {-9, 13, 0.02},  {23, 17, 0.012},
                           {-31, 19, 0.012}, {37, -41, 0.01}, {53, 29, 0.008}, {-61, -47, 0.008}};

Vector3d towards(double azimuth_rad, double elevation_rad) {
  return {std::cos(elevation_rad) * std::cos(azimuth_rad), std::cos(elevation_rad) * std::sin(azimuth_rad),
          std::sin(elevation_rad)};
}

/// A fern: fronds that rise and bend outwards, with leaflets on both sides.
void appendPlant(const Vector3d& root, CounterRandom& random, TriangleMesh& mesh) {
  const int fronds = 5 + static_cast<int>(random.uniform(0, 6));
  const double turn = random.uniform(0, kTurn), reach_m = random.uniform(0.35, 0.9);
  for (int n = 0; n < fronds; ++n) {
    const double azimuth = turn + kTurn * (n + random.uniform(-0.3, 0.3)) / fronds;
    double elevation = random.uniform(55, 80) * kDegree;
    constexpr int kPieces = 6;
    Vector3d at = root;
    for (int piece = 0; piece < kPieces; ++piece) {
      const Vector3d next = at + reach_m / kPieces * towards(azimuth, elevation);
      appendRoundCone({at, next, 0.003, 0.0025}, kChordError_m, mesh);
      const double leaflet_m = 0.16 * reach_m * (1 - 0.7 * piece / kPieces);
      for (const double share : {0.2, 0.6, 1.0}) {
        for (const double side : {-1.0, 1.0}) {
          const Vector3d foot = at + share * (next - at);
          appendNeedle({foot, foot + leaflet_m * towards(azimuth + side * 70 * kDegree, 10 * kDegree), 0.005, 0.0005},
                       mesh);
        }
      }
      at = next;
      elevation -= random.uniform(12, 22) * kDegree;
    }
  }
}

}  // namespace

double groundHeight_m(double x_m, double y_m) {
  double height_m = 0;
  for (const Wave& wave : kWaves) {
    height_m += wave.height_m * std::sin(kTurn * (wave.along_x * x_m + wave.along_y * y_m) / kGroundPeriod_m +
                                         wave.along_x + 2.0 * wave.along_y);
  }
  return height_m;
}

TriangleMesh makeGroundTile() {
  constexpr auto kSteps = static_cast<std::uint32_t>(kGroundPeriod_m / kGroundStep_m + 0.5);
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i <= kSteps; ++i) {
    for (std::uint32_t j = 0; j <= kSteps; ++j) {
      const double x_m = kGroundPeriod_m * i / kSteps, y_m = kGroundPeriod_m * j / kSteps;
      // The far edges equal the near ones of the next tile, to the last bit.
      mesh.vertices_W.push_back(
          Vector3d(x_m, y_m, groundHeight_m(i == kSteps ? 0 : x_m, j == kSteps ? 0 : y_m)).cast<float>());
    }
  }
  for (std::uint32_t i = 0; i < kSteps; ++i) {
    for (std::uint32_t j = 0; j < kSteps; ++j) {
      const std::uint32_t a = i * (kSteps + 1) + j, b = a + kSteps + 1;
      mesh.triangles.push_back({a, b, b + 1});
      mesh.triangles.push_back({a, b + 1, a + 1});
    }
  }
  return mesh;
}

TriangleMesh makeUndergrowth(std::uint64_t seed) {
  CounterRandom random({seed, 0x756e646572ull});
  const auto somewhere = [&] {
    const double radius_m = kPatchRadius_m * std::sqrt(random.uniform()), azimuth = random.uniform(0, kTurn);
    return Vector3d(radius_m * std::cos(azimuth), radius_m * std::sin(azimuth), 0);
  };
  TriangleMesh mesh;
  for (int n = 0; n < kPlants; ++n) appendPlant(somewhere(), random, mesh);
  for (int n = 0; n < kTwigs; ++n) {
    const double height_m = random.uniform(0, 0.08);  // one number per statement: the order is not the compiler's
    const Vector3d from = somewhere() + Vector3d(0, 0, height_m);
    const double length_m = random.uniform(0.15, 0.9), radius_m = random.uniform(0.003, 0.015);
    const double rise = random.uniform(-3, 8) * kDegree, turn = random.uniform(0, kTurn);
    const Vector3d to = from + length_m * towards(turn, rise);
    appendRoundCone({from, to, radius_m, 0.7 * radius_m}, kChordError_m, mesh);
  }
  return mesh;
}

}  // namespace accessvdb::sim
