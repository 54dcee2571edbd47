// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a point inherits from the points around it: its normal and the directions it counts as seen from.
///
/// Depends only on the current points, not on when it is computed (docs/DESIGN.md, "Exact updates").
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "points/nearest_points.h"
#include "points/point_store.h"
#include "points/surface_columns.h"

namespace accessvdb::internal {

struct Neighbourhood {
  /// Zero if fewer than three points are near, and of points that are not scored (kernels::writeBesideSurface).
  Eigen::Vector3f normal_L = {0, 0, 0};
  DirectionMask seen = {};          ///< own directions joined with those of the nearest ten
  float reach_m = 0;                ///< points farther away cannot change these, but whether the point is scored
  bool wide_views_changed = false;  ///< of a wide set: joined directions, which are written in place
};

/// Points that share their seen directions (docs/PAPER_MAP.md, "Normals": the 10 nearest, including the point itself).
inline constexpr std::size_t kViewNeighbours = 10;
/// Search radius for neighbours.
double neighbourRadius_m(double voxel_size_m);

class NeighbourhoodSearch {
 public:
  NeighbourhoodSearch(const PointStore& points, const FieldParams& resolved);

  /// Computes each id in parallel. @param ids  in any order; fastest if nearby points share blocks. @param out  [ids]
  /// @param wide_seen  of a wide set, in place of Neighbourhood::seen: the joined directions of all points by id, in
  /// host memory, each PointStore::directionWords(); those of the ids are brought up to date
  void compute(std::span<const std::uint32_t> ids, std::span<Neighbourhood> out,
               std::uint64_t* wide_seen = nullptr) const;

  [[nodiscard]] double radius_m() const { return radius_m_; }
  /// Which points are scored; those that compete may be farther away than neighbours.
  [[nodiscard]] const kernels::SurfaceChoice& choice() const { return choice_; }

 private:
  [[nodiscard]] Neighbourhood fromNeighbours(std::uint32_t id, const Neighbours& neighbours, double steps_per_m) const;
  [[nodiscard]] bool joinWide(std::uint32_t id, const Neighbours& neighbours, std::uint64_t* joined) const;

  const PointStore& points_;
  int k_;
  bool join_views_;
  double voxel_size_m_, radius_m_;
  kernels::SurfaceChoice choice_;
};

}  // namespace accessvdb::internal
