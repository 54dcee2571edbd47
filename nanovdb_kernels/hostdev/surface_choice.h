// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which of the points that noise spreads around a surface is scored if only one is to be (docs/design/points.md, "One
/// point where the surface is").
///
/// Points compete along the main axis of a normal, with those of the same cell across it that were seen from the same
/// side. A point looks at those of them within a window around its own height, and is on the surface if it is the
/// nearest to the mean height of their returns. That mean rises with the point's height, so of all that compete at
/// least one is on the surface, and from any other one a way of steps within the window leads to one that is.
///
/// All sums are whole numbers: nothing depends on the order of the points, the number of threads, or the backend.
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// Heights are whole numbers, so many to a voxel.
inline constexpr int kHeightsPerVoxel = 1024;
/// More returns of a point count as this many, so that no sum overflows.
inline constexpr std::uint32_t kMostReturnsThatCount = 65535;

/// Constants of the choice.
struct SurfaceChoice {
  std::int32_t edge = 0;    ///< [voxels] of a cell across the axis; 0: every point is scored
  std::int32_t window = 0;  ///< [heights] up and down
  double per_metre = 0;     ///< heights

  static SurfaceChoice of(double voxel_size_m, double spacing_m, double window_m) {
    SurfaceChoice choice;
    const double edge = std::floor(spacing_m / voxel_size_m + 0.5);
    choice.edge = edge < 1 ? 1 : static_cast<std::int32_t>(edge);
    choice.per_metre = kHeightsPerVoxel / voxel_size_m;
    choice.window = static_cast<std::int32_t>(std::floor(window_m * choice.per_metre));
    return choice;
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool isMade() const { return edge > 0; }
  /// Of a coordinate of a mean position, in the local frame.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int32_t heightOf(float coordinate_m) const {
    return static_cast<std::int32_t>(floor(static_cast<double>(coordinate_m) * per_metre));
  }
  /// Lowest voxel of the cell that holds voxel i, along one axis.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int32_t cellOf(std::int32_t i) const {
    const std::int32_t beyond = i % edge;
    return i - (beyond < 0 ? beyond + edge : beyond);
  }
  /// [voxels] No point farther up or down is within the window: means lie in their voxel, but for a quarter of one by
  /// rounding.
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int32_t windowVoxels() const { return window / kHeightsPerVoxel + 2; }
  /// [voxels] From a point to the farthest one that competes with it; 0 if every point is scored.
  [[nodiscard]] double reachVoxels() const { return isMade() ? std::hypot(windowVoxels(), edge, edge) : 0; }
};

/// Voxels that may hold a point with which another one competes, inclusive.
struct CompetingVoxels {
  std::int32_t low[3], high[3];

  ACCESSVDB_HOSTDEV CompetingVoxels(const SurfaceChoice& choice, const std::int32_t* voxel, int axis) {
    for (int k = 0; k < 3; ++k) {
      low[k] = k == axis ? voxel[k] - choice.windowVoxels() : choice.cellOf(voxel[k]);
      high[k] = k == axis ? voxel[k] + choice.windowVoxels() : low[k] + choice.edge - 1;
    }
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool hold(const std::int32_t* voxel) const {
    bool holds = true;
    for (int k = 0; k < 3; ++k) holds = holds && voxel[k] >= low[k] && voxel[k] <= high[k];
    return holds;
  }
};

/// The axis along which a surface with this normal is crossed most steeply; of equals the first.
ACCESSVDB_HOSTDEV inline int mainAxis(const float* normal) {
  int axis = 0;
  float most = normal[0] < 0 ? -normal[0] : normal[0];
  for (int k = 1; k < 3; ++k) {
    const float size = normal[k] < 0 ? -normal[k] : normal[k];
    if (size > most) axis = k, most = size;
  }
  return axis;
}

/// A point that competes.
struct CompetingPoint {
  std::int32_t height = 0;
  std::uint32_t returns = 0;
  std::int32_t voxel[3] = {0, 0, 0};  ///< decides between equals
};

/// The returns within the window of a point, all of its cell and side: first all points are added, then compared.
struct WindowReturns {
  CompetingPoint own;
  std::int32_t window = 0;               ///< [heights]
  std::int64_t returns = 0, moment = 0;  ///< their number, and the sum of their heights above the own one

  ACCESSVDB_HOSTDEV void add(const CompetingPoint& point) {
    if (!holds(point)) return;
    const std::int64_t count = point.returns < kMostReturnsThatCount ? point.returns : kMostReturnsThatCount;
    returns += count;
    moment += count * above(point);
  }
  /// Whether a point is nearer to the mean height than the own one.
  [[nodiscard]] ACCESSVDB_HOSTDEV bool isNearer(const CompetingPoint& point) const {
    if (!holds(point)) return false;
    const std::int64_t up = above(point), above_mean = up * returns - moment;
    const std::int64_t distance = above_mean < 0 ? -above_mean : above_mean,  // times the returns
        own_distance = moment < 0 ? -moment : moment;
    if (distance != own_distance) return distance < own_distance;
    if (up != 0) return up < 0;  // of two at the same distance the lower one is the nearer
    int k = 0;
    while (k < 2 && point.voxel[k] == own.voxel[k]) ++k;
    return point.voxel[k] < own.voxel[k];
  }

 private:
  [[nodiscard]] ACCESSVDB_HOSTDEV std::int64_t above(const CompetingPoint& point) const {
    return static_cast<std::int64_t>(point.height) - own.height;
  }
  [[nodiscard]] ACCESSVDB_HOSTDEV bool holds(const CompetingPoint& point) const {
    const std::int64_t up = above(point);
    return up <= window && up >= -static_cast<std::int64_t>(window);
  }
};

/// @param own  one of the points  @param forEach  calls visit(const CompetingPoint&) for points of its cell and side:
///   all within the window, in any order, and `own` itself
template <class ForEach>
[[nodiscard]] ACCESSVDB_HOSTDEV bool isOnSurface(const CompetingPoint& own, std::int32_t window,
                                                 const ForEach& forEach) {
  WindowReturns around = {own, window};
  forEach([&](const CompetingPoint& point) { around.add(point); });
  bool nearest = true;
  forEach([&](const CompetingPoint& point) { nearest = nearest && !around.isNearer(point); });
  return nearest;
}

/// A point beside the surface has no normal: it is zero, with a sign on its main axis. So whatever asks for a normal
/// finds none, and such a point is never scored.
ACCESSVDB_HOSTDEV inline void writeBesideSurface(int axis, float* normal) {
  for (int k = 0; k < 3; ++k) normal[k] = k == axis ? -0.0f : 0.0f;
}
/// @return the main axis of a point beside the surface; -1 for all other points
ACCESSVDB_HOSTDEV inline int besideSurfaceAxis(const float* normal) {
  if (normal[0] != 0 || normal[1] != 0 || normal[2] != 0) return -1;
  for (int k = 0; k < 3; ++k) {
    if (copysignf(1.0f, normal[k]) < 0) return k;
  }
  return -1;
}
/// @return the axis along which a point with this normal competes; -1 if it has none
ACCESSVDB_HOSTDEV inline int competingAxis(const float* normal) {
  return normal[0] != 0 || normal[1] != 0 || normal[2] != 0 ? mainAxis(normal) : besideSurfaceAxis(normal);
}

}  // namespace accessvdb::kernels
