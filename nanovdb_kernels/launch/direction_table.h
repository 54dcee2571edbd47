// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The axes of a set of orientations, as points and kernels read them.
#pragma once

#include <cstdint>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// Computed in double and rounded once. One of the two lists is empty.
struct DirectionTable {
  std::vector<float> xy;        ///< [2 D] of yaw: a_d = (cos, sin)(2 pi d / D)
  std::vector<float> axes_xyz;  ///< [3 D] of any other set

  [[nodiscard]] int numDirections() const { return static_cast<int>(xy.size() / 2 + axes_xyz.size() / 3); }  ///< [D]
  /// Points the view, whose directions are null, to the list that is there.
  void showIn(ApproachView& view) const {
    if (!xy.empty()) view.direction_xy = xy.data();
    if (!axes_xyz.empty()) view.axes_xyz = axes_xyz.data();
  }
  [[nodiscard]] std::uint64_t bytes() const { return (xy.capacity() + axes_xyz.capacity()) * sizeof(float); }
};

}  // namespace accessvdb::kernels
