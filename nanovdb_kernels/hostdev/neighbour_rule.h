// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points are neighbours of a surface point, and the normal derived from them (docs/PAPER_MAP.md, "Normals").
///
/// Offsets from the point are first rounded to a fixed step. Then everything up to the covariance is integer
/// arithmetic, so the result does not depend on the order of the neighbours, the number of threads, or the backend.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/surface_normal.h"

namespace accessvdb::kernels {

/// Steps of the largest offset: 2^19 to 2^20 steps per radius. With at most 500 neighbours no sum of products
/// overflows.
inline constexpr int kRadiusBits = 20;

/// Steps per metre: a power of two, so that positions on a dyadic grid keep their ties.
inline double neighbourStepsPerMetre(double radius_m) {
  return std::exp2(std::floor(kRadiusBits - std::log2(radius_m)));
}
/// Largest squared distance of a neighbour, in steps.
inline std::int64_t neighbourRadiusSquared(double radius_m) {
  const double steps = std::floor(radius_m * neighbourStepsPerMetre(radius_m));
  return static_cast<std::int64_t>(steps) * static_cast<std::int64_t>(steps);
}

/// An offset in steps.
struct NeighbourOffset {
  std::int64_t x, y, z;
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int64_t squared() const { return x * x + y * y + z * z; }
};

/// For positions that are less than 2^10 radii apart.
ACCESSVDB_HOSTDEV inline NeighbourOffset neighbourOffset(const float* from, const float* to, double steps_per_m) {
  const auto steps = [steps_per_m](float a, float b) {
    return static_cast<std::int64_t>(floor((static_cast<double>(b) - static_cast<double>(a)) * steps_per_m + 0.5));
  };
  return {steps(from[0], to[0]), steps(from[1], to[1]), steps(from[2], to[2])};
}

/// No point farther away than this can change the result of these neighbours: rounding is less than one step per axis.
/// @param squared  of the farthest neighbour's distance in steps, or the largest possible one if there are fewer than k
ACCESSVDB_HOSTDEV inline float neighbourReach_m(std::int64_t squared, double steps_per_m) {
  return static_cast<float>((sqrt(static_cast<double>(squared)) + 2.0) / steps_per_m);
}

/// How far means may lie outside their voxel far from the origin, where float32 has 8 steps per voxel.
inline constexpr double kMeanRoundingVoxels = 0.25;

/// How far to look for the neighbours of a point that had some before, in steps: somewhat farther than the last time.
/// @param reach_m  neighbourReach_m() of the last time
ACCESSVDB_HOSTDEV inline double neighbourSearchSteps(float reach_m, double steps_per_m) {
  return 1.05 * static_cast<double>(reach_m) * steps_per_m;
}

/// Sums over the neighbours, including the point itself.
struct NeighbourSums {
  std::int64_t count = 0;
  std::int64_t x = 0, y = 0, z = 0;
  std::int64_t xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;

  ACCESSVDB_HOSTDEV void add(const NeighbourOffset& o) {
    ++count;
    x += o.x, y += o.y, z += o.z;
    xx += o.x * o.x, xy += o.x * o.y, xz += o.x * o.z;
    yy += o.y * o.y, yz += o.y * o.z, zz += o.z * o.z;
  }
};

inline constexpr std::int64_t kFewestForNormal = 3;

/// count^2 times the covariance: the eigenvectors are the same. Zero if there are too few neighbours for a normal.
ACCESSVDB_HOSTDEV inline Covariance neighbourCovariance(const NeighbourSums& s) {
  Covariance covariance;
  if (s.count < kFewestForNormal) return covariance;
  covariance.xx = static_cast<double>(s.count * s.xx - s.x * s.x);
  covariance.xy = static_cast<double>(s.count * s.xy - s.x * s.y);
  covariance.xz = static_cast<double>(s.count * s.xz - s.x * s.z);
  covariance.yy = static_cast<double>(s.count * s.yy - s.y * s.y);
  covariance.yz = static_cast<double>(s.count * s.yz - s.y * s.z);
  covariance.zz = static_cast<double>(s.count * s.zz - s.z * s.z);
  return covariance;
}

/// Turns a normal towards the sensor. @param to_sensor  from the point towards the mean sensor position, metres
ACCESSVDB_HOSTDEV inline void turnTowards(const float* to_sensor, float* normal) {
  const double side = static_cast<double>(normal[0]) * static_cast<double>(to_sensor[0]) +
                      static_cast<double>(normal[1]) * static_cast<double>(to_sensor[1]) +
                      static_cast<double>(normal[2]) * static_cast<double>(to_sensor[2]);
  if (side < 0) {
    for (int axis = 0; axis < 3; ++axis) normal[axis] = -normal[axis];
  }
}

/// Unit normal towards the sensor; zero if there are too few neighbours.
/// @param to_sensor  as for turnTowards
ACCESSVDB_HOSTDEV inline void neighbourNormal(const NeighbourSums& s, const float* to_sensor, float* normal) {
  for (int axis = 0; axis < 3; ++axis) normal[axis] = 0;
  if (s.count < kFewestForNormal) return;
  smallestEigenvector(neighbourCovariance(s), normal);
  turnTowards(to_sensor, normal);
}

}  // namespace accessvdb::kernels
