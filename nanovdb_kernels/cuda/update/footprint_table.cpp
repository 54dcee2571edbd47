// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "cuda/update/footprint_table.h"

#include <algorithm>
#include <vector>

namespace accessvdb::kernels {

FootprintTable::FootprintTable(DeviceMemory& memory, const ToolTables& tables, int group_log2)
    : group_log2_(group_log2) {
  for (const std::span<const FootprintColumn> columns : {tables.tool_columns, tables.arm_columns}) {
    for (const FootprintColumn& c : columns) {
      const std::int32_t low[3] = {c.dx, c.dy, c.z_low}, high[3] = {c.dx, c.dy, c.z_high};
      for (int axis = 0; axis < 3; ++axis) {
        view_.low[axis] = std::min(view_.low[axis], low[axis]);
        view_.high[axis] = std::max(view_.high[axis], high[axis]);
      }
    }
  }
  const auto side = static_cast<std::size_t>(view_.high[1] - view_.low[1] + 1);
  std::vector<FootprintPlace> places(static_cast<std::size_t>(view_.high[0] - view_.low[0] + 1) * side);
  std::vector<FootprintPlace> heights(places.size());
  const auto indexOf = [&](const FootprintColumn& c) {
    return static_cast<std::size_t>(c.dx - view_.low[0]) * side + static_cast<std::size_t>(c.dy - view_.low[1]);
  };
  const auto note = [&](std::span<const FootprintColumn> columns, std::uint32_t FootprintPlace::*part) {
    std::uint32_t number = 0;
    for (const FootprintColumn& c : columns) {
      ++number;
      if (heights[indexOf(c)].*part == 0) places[indexOf(c)].*part = number;
      ++(heights[indexOf(c)].*part);
    }
  };
  note(tables.tool_columns, &FootprintPlace::tool);
  note(tables.arm_columns, &FootprintPlace::arm);
  const auto load = [&](auto& to, const auto& from) {
    to.grow(memory, from.size(), 0);
    to.upload(from.data(), from.size());
  };
  load(tool_, tables.tool_columns);
  load(arm_, tables.arm_columns);
  load(places_, places);
  view_.tool = tool_.data();
  view_.arm = arm_.data();
  view_.places = places_.data();
  if (!tables.any_directions) return;
  load(heights_, heights);
  view_.heights = heights_.data();
}

VoxelBox FootprintTable::reachOfSearch() const {
  constexpr std::int32_t kSlabs = 16;  // slabs extend beyond the lowest and the highest voxel
  const std::int32_t from_group = (8 << group_log2_) - 1;
  VoxelBox reach;
  for (int axis = 0; axis < 3; ++axis) {
    reach.low[axis] = 8 * view_.low[axis] - from_group - (axis == 2 ? kSlabs : 0);
    reach.high[axis] = 8 * view_.high[axis] + 7 + (axis == 2 ? kSlabs : 0);
  }
  return reach;
}

}  // namespace accessvdb::kernels
