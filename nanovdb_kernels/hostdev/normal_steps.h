// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Normals in steps: a grid on the faces of a cube, so that a small turn of a normal changes nothing that follows from
/// it (docs/DESIGN.md, "Steps of means and normals").
#pragma once

#include <cmath>
#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

/// The grid point of a direction: its largest component becomes +-most, the others are rounded to whole steps, halves
/// away from zero. Where two components are equally large, both faces give the same point.
/// @param direction  not zero  @param most  steps from the middle of a face to its edge
ACCESSVDB_HOSTDEV inline void normalInSteps(const float* direction, int most, std::int32_t* steps) {
  float largest = 0;
  for (int axis = 0; axis < 3; ++axis) largest = fmaxf(largest, fabsf(direction[axis]));
  for (int axis = 0; axis < 3; ++axis) {
    const float magnitude = fabsf(direction[axis]) / largest * static_cast<float>(most);
    const auto whole = static_cast<std::int32_t>(floorf(magnitude + 0.5f));
    steps[axis] = direction[axis] < 0 ? -whole : whole;
  }
}

/// Moves a unit vector to its grid point, and back to unit length; zero stays zero. @param most  as above
ACCESSVDB_HOSTDEV inline void roundNormal(float* normal, int most) {
  if (normal[0] == 0 && normal[1] == 0 && normal[2] == 0) return;
  std::int32_t steps[3];
  normalInSteps(normal, most, steps);
  const std::int32_t squared = steps[0] * steps[0] + steps[1] * steps[1] + steps[2] * steps[2];
  const float length = sqrtf(static_cast<float>(squared));
  for (int axis = 0; axis < 3; ++axis) normal[axis] = static_cast<float>(steps[axis]) / length;
}

}  // namespace accessvdb::kernels
