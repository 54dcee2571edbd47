// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The voxels around one whose weights count for it, in the leaves that hold them: at most two along each axis.
#pragma once

#include <cstdint>

#include "hostdev/nanovdb_compat.h"

namespace accessvdb::kernels {

inline constexpr int kWindowParts = 8;

/// Those in one leaf.
struct WindowPart {
  std::int32_t first[3], last[3];  ///< voxels; first > last: none
  ACCESSVDB_HOSTDEV bool empty() const { return first[0] > last[0] || first[1] > last[1] || first[2] > last[2]; }
  ACCESSVDB_HOSTDEV bool holds(const std::int32_t* voxel) const {
    for (int axis = 0; axis < 3; ++axis)
      if (voxel[axis] < first[axis] || voxel[axis] > last[axis]) return false;
    return true;
  }
};

/// @param reach  at most 4: else there may be three  @param part  of kWindowParts: bit n says whether it is the upper
/// leaf along axis n
ACCESSVDB_HOSTDEV inline WindowPart windowPart(const std::int32_t* voxel, std::int32_t reach, int part) {
  WindowPart of;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int32_t first = voxel[axis] - reach, last = voxel[axis] + reach, border = first | 7;
    const bool is_upper = (part >> axis & 1) != 0;
    of.first[axis] = is_upper ? border + 1 : first;
    of.last[axis] = is_upper || last < border ? last : border;
  }
  return of;
}

}  // namespace accessvdb::kernels
