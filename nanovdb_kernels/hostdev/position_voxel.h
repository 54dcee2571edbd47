// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which voxel a position has: one rule for returns, points, files, queries and tiles.
///
/// Voxel i reaches from its lower face, (i - 1/2) v, up to but not including the upper one. A position within rounding
/// of a face counts as on it: coordinates with few decimals often are, and which side they end up on must not depend on
/// float32, on the origin or on who divides. Positions that are stored are moved off the faces into their voxels, so
/// that every way to compute their voxel gives the same: voxelIndex(), division in double, OpenVDB's transforms.
#pragma once

#include <cmath>
#include <cstdint>

#include "occupancy_query.h"

namespace accessvdb::kernels {

/// How far stored positions stay from faces, in voxels: more than world coordinates, steps of the local frame and
/// voxelIndex() (three roundings) are off. Below half a voxel within 10^6 voxels of the origin.
/// @param x  coordinate, voxels
ACCESSVDB_HOSTDEV inline double roundingAtFaces(double x, double inverse_voxel_size) {
  constexpr double kSteps_m = 0x1.0p-19, kFloatRoundings = 5 * 0x1.0p-24;
  return kSteps_m * inverse_voxel_size + kFloatRoundings * fabs(x);
}

/// Index of the voxel of a coordinate, as a whole number: not finite for NaN and infinity.
/// @param x_m  local frame  @param inverse_voxel_size  VoxelScale::inverse_float32
ACCESSVDB_HOSTDEV inline double voxelOfCoordinate(double x_m, double inverse_voxel_size) {
  const double x = x_m * inverse_voxel_size;
  return floor(x + 0.5 + 0.5 * roundingAtFaces(x, inverse_voxel_size));
}

/// @param p_L  a position that has a voxel (hasVoxel)
ACCESSVDB_HOSTDEV inline Coord voxelOfPosition(const double* p_L, double inverse_voxel_size) {
  return Coord(static_cast<std::int32_t>(voxelOfCoordinate(p_L[0], inverse_voxel_size)),
               static_cast<std::int32_t>(voxelOfCoordinate(p_L[1], inverse_voxel_size)),
               static_cast<std::int32_t>(voxelOfCoordinate(p_L[2], inverse_voxel_size)));
}

/// The coordinate as it is stored: itself, or as near as stored positions come to the face that it is at.
ACCESSVDB_HOSTDEV inline float storedCoordinate(double x_m, double inverse_voxel_size) {
  const double x = x_m * inverse_voxel_size, voxel = voxelOfCoordinate(x_m, inverse_voxel_size);
  const double most = 0.5 - roundingAtFaces(x, inverse_voxel_size), offset = x - voxel;
  if (offset < -most) return static_cast<float>((voxel - most) / inverse_voxel_size);
  if (offset > most) return static_cast<float>((voxel + most) / inverse_voxel_size);
  return static_cast<float>(x_m);
}

}  // namespace accessvdb::kernels
