// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/expanded_orientations.h"

#include <cstddef>

namespace accessvdb::internal {

ExpandedOrientations ExpandedOrientations::of(const ApproachParams& resolved) {
  return {resolved.orientations.orientations(resolved.num_directions), resolved.orientations.isYaw()};
}

ExpandedOrientations ExpandedOrientations::sampled(int most) const {
  if (most >= count()) return *this;
  if (is_yaw) return {OrientationSet::yaw().orientations(most), true};
  ExpandedOrientations some = {{}, false};
  const std::size_t size = all.size(), wanted = static_cast<std::size_t>(most);
  for (std::size_t n = 0; n < wanted; ++n) some.all.push_back(all[(2 * n + 1) * size / (2 * wanted)]);
  return some;
}

kernels::DirectionTable ExpandedOrientations::table() const {
  kernels::DirectionTable table;
  std::vector<float>& to = is_yaw ? table.xy : table.axes_xyz;
  const Eigen::Index axes = is_yaw ? 2 : 3;
  to.reserve(static_cast<std::size_t>(axes) * all.size());
  for (const ToolOrientation& orientation : all) {
    for (Eigen::Index axis = 0; axis < axes; ++axis) {
      to.push_back(static_cast<float>(orientation.R_WT(axis, 0)) + 0.0f);  // never -0
    }
  }
  return table;
}

void addOffsetsAlong(const ToolOrientation& orientation, std::span<const double> distances_m,
                     std::vector<float>& offsets_m) {
  for (const double distance_m : distances_m) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      offsets_m.push_back(static_cast<float>(distance_m * orientation.R_WT(axis, 0)) + 0.0f);  // never -0
    }
  }
}

}  // namespace accessvdb::internal
