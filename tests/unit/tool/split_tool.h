// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Tools given voxel by voxel, for tests of columns: cut into pieces of at most 64 voxels, in any order.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "hostdev/views.h"

namespace accessvdb::test {

using VoxelSet = std::set<std::array<std::int32_t, 3>>;

/// Adds an inclusive box.
inline void addBox(VoxelSet& voxels, const std::array<std::int32_t, 3>& low, const std::array<std::int32_t, 3>& high) {
  for (std::int32_t x = low[0]; x <= high[0]; ++x)
    for (std::int32_t y = low[1]; y <= high[1]; ++y)
      for (std::int32_t z = low[2]; z <= high[2]; ++z) voxels.insert({x, y, z});
}

inline std::int32_t within(std::mt19937_64& random, std::int32_t low, std::int32_t high) {
  return low + static_cast<std::int32_t>(random() % static_cast<std::uint64_t>(high - low + 1));
}

struct SplitTool {
  std::vector<VoxelSet> voxels;  ///< [D]
  std::vector<kernels::VoxelColumn> columns;
  std::vector<std::uint32_t> begin = {0};
  int split = 0;  ///< columns that continue above another

  void addDirection(const VoxelSet& of_direction, std::mt19937_64& random) {
    const std::size_t first = columns.size();
    for (const auto& [x, y, z] : of_direction) {  // z runs fastest
      const bool same = columns.size() > first && columns.back().dx == x && columns.back().dy == y;
      if (!same || z - columns.back().dz >= 64) {
        split += same ? 1 : 0;
        const int empty_below = within(random, 0, 5);
        columns.push_back({static_cast<std::int16_t>(x), static_cast<std::int16_t>(y),
                           static_cast<std::int16_t>(z - empty_below), 0, 0});
      }
      columns.back().bits |= std::uint64_t{1} << (z - columns.back().dz);
    }
    for (std::size_t n = columns.size(); n > first + 1; --n) {
      std::swap(columns[n - 1], columns[first + random() % (n - first)]);
    }
    begin.push_back(static_cast<std::uint32_t>(columns.size()));
    voxels.push_back(of_direction);
  }
  [[nodiscard]] int numDirections() const { return static_cast<int>(voxels.size()); }
  [[nodiscard]] kernels::ToolKernelView view() const {
    kernels::ToolKernelView view;
    view.columns = columns.data();
    view.column_begin = begin.data();
    return view;
  }
};

}  // namespace accessvdb::test
