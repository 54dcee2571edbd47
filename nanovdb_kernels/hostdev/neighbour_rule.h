// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are neighbours of a surface point, and the normal derived from them (docs/PAPER_MAP.md, "Normals").
///
/// Neighbourhoods have a frame of their own, N: the local frame in other units. Mean returns are in whole steps of a
/// fraction of the voxel, and so are the distances between them; then a return that moves a mean by less than a step
/// changes nothing. First returns, which never move, are in metres, and the offset between two of them is rounded to a
/// fine step. From there on everything up to the covariance is integer arithmetic, so the result does not depend on the
/// order of the neighbours, the number of threads, or the backend.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/normal_steps.h"
#include "hostdev/surface_normal.h"

namespace accessvdb::kernels {

/// The steps that means and normals are rounded to.
struct NeighbourSteps {
  int mean;    ///< per voxel; a power of two
  int normal;  ///< from the middle of a cube's face to its edge (hostdev/normal_steps.h)
};
/// The noisier the ranges, the coarser the steps: they have to be small compared only with what the noise does to means
/// and normals anyway (docs/evaluation.md, "noise").
inline NeighbourSteps neighbourSteps(double range_noise_voxels) {
  if (range_noise_voxels >= 2) return {4, 16};
  if (range_noise_voxels >= 1) return {4, 24};
  if (range_noise_voxels >= 0.5) return {8, 32};
  return range_noise_voxels >= 0.25 ? NeighbourSteps{16, 48} : NeighbourSteps{32, 64};
}

/// Steps of the largest offset between first returns: 2^19 to 2^20 steps per radius. With at most 500 neighbours no sum
/// of products overflows.
inline constexpr int kRadiusBits = 20;

/// Returns of a point along one axis.
struct AxisSum {
  std::int64_t offsets;   ///< from the centre of the point's voxel, in 2^-20 voxels, none more than a voxel
  std::uint32_t returns;  ///< their number
};
/// A mean return in whole steps from the origin, halves rounded up. The number of steps is exact for any number of
/// returns; where it exceeds 2^24, float32 rounds it to an even one. @param voxel  of the point
ACCESSVDB_HOSTDEV inline float meanInSteps(std::int32_t voxel, const AxisSum& sum, int steps_per_voxel) {
  const std::int64_t divisor = static_cast<std::int64_t>(sum.returns) << 21;
  const std::int64_t dividend = 2 * steps_per_voxel * sum.offsets + divisor / 2;
  std::int64_t steps = dividend / divisor;
  if (steps * divisor > dividend) --steps;  // division rounds towards zero
  return static_cast<float>(static_cast<std::int64_t>(voxel) * steps_per_voxel + steps);
}

/// What positions in frame N are.
struct NeighbourScale {
  bool whole_steps = false;         ///< positions are in whole steps; else they are in metres
  int normal_steps = 0;             ///< NeighbourSteps::normal; 0: normals are not rounded
  double voxels_per_unit = 0;       ///< of positions
  double steps_per_unit = 0;        ///< of positions
  std::int64_t radius_squared = 0;  ///< largest squared distance of a neighbour, steps
};

/// For first returns. @param radius_m  no neighbour is farther away
inline NeighbourScale scaleOfFirstReturns(double voxel_size_m, double radius_m) {
  NeighbourScale scale;
  scale.voxels_per_unit = 1 / voxel_size_m;
  // A power of two, so that positions on a dyadic grid keep their ties.
  scale.steps_per_unit = std::exp2(std::floor(kRadiusBits - std::log2(radius_m)));
  const auto radius = static_cast<std::int64_t>(std::floor(radius_m * scale.steps_per_unit));
  scale.radius_squared = radius * radius;
  return scale;
}
/// For mean returns. @param radius_voxels  no neighbour is farther away
inline NeighbourScale scaleOfMeans(double radius_voxels, const NeighbourSteps& steps) {
  NeighbourScale scale;
  scale.whole_steps = true;
  scale.normal_steps = steps.normal;
  scale.voxels_per_unit = 1.0 / steps.mean;
  scale.steps_per_unit = 1;
  const auto radius = static_cast<std::int64_t>(std::floor(radius_voxels * steps.mean + 0.5));
  scale.radius_squared = radius * radius;
  return scale;
}

/// An offset in steps.
struct NeighbourOffset {
  std::int32_t x, y, z;
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int64_t squared() const {
    return std::int64_t{x} * x + std::int64_t{y} * y + std::int64_t{z} * z;
  }
};

/// For positions that are less than 2^10 radii apart.
ACCESSVDB_HOSTDEV inline NeighbourOffset neighbourOffset(const float* from_N, const float* to_N,
                                                         const NeighbourScale& scale) {
  if (scale.whole_steps) {  // differences of whole numbers: exact
    return {static_cast<std::int32_t>(to_N[0] - from_N[0]), static_cast<std::int32_t>(to_N[1] - from_N[1]),
            static_cast<std::int32_t>(to_N[2] - from_N[2])};
  }
  const auto steps = [&scale](float a, float b) {
    return static_cast<std::int32_t>(
        floor((static_cast<double>(b) - static_cast<double>(a)) * scale.steps_per_unit + 0.5));
  };
  return {steps(from_N[0], to_N[0]), steps(from_N[1], to_N[1]), steps(from_N[2], to_N[2])};
}

/// No point farther away than this can change the result of these neighbours. Offsets between first returns are off by
/// less than a step per axis.
/// @param squared  of the farthest neighbour's distance in steps, or the largest possible one if there are fewer than k
ACCESSVDB_HOSTDEV inline float neighbourReach_N(std::int64_t squared, const NeighbourScale& scale) {
  const double steps = sqrt(static_cast<double>(squared));
  return static_cast<float>((scale.whole_steps ? steps : steps + 2.0) / scale.steps_per_unit);
}

/// Sums over the neighbours, including the point itself.
struct NeighbourSums {
  std::int64_t count = 0;
  std::int64_t x = 0, y = 0, z = 0;
  std::int64_t xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  ACCESSVDB_HOSTDEV void add(const NeighbourOffset& o) {
    const std::int64_t ox = o.x, oy = o.y, oz = o.z;
    ++count;
    x += ox, y += oy, z += oz;
    xx += ox * ox, xy += ox * oy, xz += ox * oz;
    yy += oy * oy, yz += oy * oz, zz += oz * oz;
  }
};

inline constexpr std::int64_t kFewestForNormal = 3;

/// Unit normal towards the sensor, in steps if the scale has any; zero if there are too few neighbours.
/// @param to_sensor  from the point towards the mean sensor position, metres
ACCESSVDB_HOSTDEV inline void neighbourNormal(const NeighbourSums& s, const float* to_sensor,
                                              const NeighbourScale& scale, float* normal) {
  for (int axis = 0; axis < 3; ++axis) normal[axis] = 0;
  if (s.count < kFewestForNormal) return;
  // count^2 times the covariance: the eigenvectors are the same.
  Covariance covariance;
  covariance.xx = static_cast<double>(s.count * s.xx - s.x * s.x);
  covariance.xy = static_cast<double>(s.count * s.xy - s.x * s.y);
  covariance.xz = static_cast<double>(s.count * s.xz - s.x * s.z);
  covariance.yy = static_cast<double>(s.count * s.yy - s.y * s.y);
  covariance.yz = static_cast<double>(s.count * s.yz - s.y * s.z);
  covariance.zz = static_cast<double>(s.count * s.zz - s.z * s.z);
  smallestEigenvector(covariance, normal);
  const double side = static_cast<double>(normal[0]) * static_cast<double>(to_sensor[0]) +
                      static_cast<double>(normal[1]) * static_cast<double>(to_sensor[1]) +
                      static_cast<double>(normal[2]) * static_cast<double>(to_sensor[2]);
  if (side < 0) {
    for (int axis = 0; axis < 3; ++axis) normal[axis] = -normal[axis];
  }
  if (scale.normal_steps > 0) roundNormal(normal, scale.normal_steps);
}

}  // namespace accessvdb::kernels
