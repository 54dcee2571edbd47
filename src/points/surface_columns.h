// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which points lie where the surface is, if only one of each cell is to be scored (hostdev/surface_choice.h).
///
/// Depends only on the current points, not on when it is asked.
#pragma once

#include <cstdint>
#include <vector>

#include "accessvdb/params.h"
#include "hostdev/surface_choice.h"
#include "points/point_store.h"

namespace accessvdb::internal {

kernels::SurfaceChoice surfaceChoice(const FieldParams& resolved);

/// With scratch memory of one thread.
class SurfaceColumns {
 public:
  SurfaceColumns(const PointStore& points, const kernels::SurfaceChoice& choice) : points_(points), choice_(choice) {}

  /// @param axis  main axis of the point's normal
  [[nodiscard]] bool isOnSurface(std::uint32_t id, int axis);

 private:
  [[nodiscard]] bool isInFront(std::uint32_t id, int axis) const { return points_.toSensor_L(id)[axis] >= 0; }
  [[nodiscard]] kernels::CompetingPoint competing(std::uint32_t id, int axis) const;

  const PointStore& points_;
  kernels::SurfaceChoice choice_;
  std::vector<std::uint32_t> ids_;
  std::vector<kernels::CompetingPoint> found_;
};

}  // namespace accessvdb::internal
