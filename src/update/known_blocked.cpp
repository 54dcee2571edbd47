// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/known_blocked.h"

#include <algorithm>
#include <array>
#include <bit>

#include "update/leaf_footprint.h"

namespace accessvdb::internal {
namespace {

std::uint64_t cellKey(std::int32_t x, std::int32_t y, std::int32_t z) {
  constexpr std::int64_t kBias = 1 << 20;
  return static_cast<std::uint64_t>(x + kBias) << 42 | static_cast<std::uint64_t>(y + kBias) << 21 |
         static_cast<std::uint64_t>(z + kBias);
}

}  // namespace

void KnownBlocked::learn(const kernels::ScoreResult& result, std::uint16_t collision_limit) {
  arm = arm | result.arm_blocked;
  if (!any(result.tool_blocked)) return;
  const auto found = static_cast<std::uint16_t>(result.least_blocked - collision_limit);
  margin = any(tool) ? std::min(margin, found) : found;
  tool = tool | result.tool_blocked;
}

DirectionMask KnownBlocked::release(const Index3& point_voxel, std::span<const Index3> flips,
                                    const OffsetDirections& directions) {
  DirectionMask touched = {};
  std::array<std::uint16_t, 64 * kernels::kMaxDirectionWords> flips_of = {};
  for (const Index3& flip : flips) {
    const std::uint64_t* entry =
        directions.at({flip[0] - point_voxel[0], flip[1] - point_voxel[1], flip[2] - point_voxel[2]});
    if (entry == nullptr) continue;
    DirectionMask reading = {};
    for (std::size_t word = 0; word < directions.words(); ++word) reading.word[word] = entry[word];
    touched = touched | reading;
    forEachDirection(reading & tool, [&](int d) {
      std::uint16_t& count = flips_of[static_cast<std::size_t>(d)];
      if (count < 0xffff) ++count;  // saturates above every margin
    });
  }
  DirectionMask released = without(touched, tool);
  std::uint16_t worn = 0;
  forEachDirection(touched & tool, [&](int d) {
    const std::uint16_t count = flips_of[static_cast<std::size_t>(d)];
    if (count > margin) {
      released.set(d);
      tool.reset(d);
    } else {
      worn = std::max(worn, count);
    }
  });
  margin = static_cast<std::uint16_t>(margin - worn);
  return released;
}

FreedVoxels::FreedVoxels(const FlipSet& flips) {
  for (const LeafChange& change : flips.changes()) {
    for (std::size_t word = 0; word < 8; ++word) {
      for (std::uint64_t bits = change.collides_off[word]; bits != 0; bits &= bits - 1) {
        const int n = std::countr_zero(bits);
        const Index3 voxel = {change.origin_ijk[0] + static_cast<std::int32_t>(word), change.origin_ijk[1] + (n >> 3),
                              change.origin_ijk[2] + (n & 7)};
        cells_[cellKey(voxel[0] >> kCellShift, voxel[1] >> kCellShift, voxel[2] >> kCellShift)].push_back(voxel);
      }
    }
  }
}

void FreedVoxels::collect(const Index3& low, const Index3& high, std::vector<Index3>& out) const {
  for (std::int32_t x = low[0] >> kCellShift; x <= high[0] >> kCellShift; ++x) {
    for (std::int32_t y = low[1] >> kCellShift; y <= high[1] >> kCellShift; ++y) {
      for (std::int32_t z = low[2] >> kCellShift; z <= high[2] >> kCellShift; ++z) {
        const auto cell = cells_.find(cellKey(x, y, z));
        if (cell == cells_.end()) continue;
        for (const Index3& voxel : cell->second) {
          if (voxel[0] >= low[0] && voxel[0] <= high[0] && voxel[1] >= low[1] && voxel[1] <= high[1] &&
              voxel[2] >= low[2] && voxel[2] <= high[2]) {
            out.push_back(voxel);
          }
        }
      }
    }
  }
}

}  // namespace accessvdb::internal
