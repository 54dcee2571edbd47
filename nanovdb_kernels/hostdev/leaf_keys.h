// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Short keys for the leaves that a scan may reach. Sorted, the leaves of a node follow each other in the order of its
/// table, and the nodes of an upper node likewise.
#pragma once

#include <cstdint>

#include "hostdev/views.h"

namespace accessvdb::kernels {

/// The upper nodes, of 4096^3 voxels, among which the leaves lie: a key has the place of the upper node among them, of
/// the lower node in it, of the leaf in that.
struct LeafKeys {
  static constexpr int kUpperShift = 27, kLowerShift = 12;
  std::int32_t low[3] = {0, 0, 0};    ///< [4096 voxels]
  std::uint32_t size[3] = {1, 1, 1};  ///< [4096 voxels] below 2^32 nodes in all
};

/// @param leaf  [3] ijk >> 3, in one of the nodes
ACCESSVDB_HOSTDEV inline std::uint64_t leafKeyOf(const LeafKeys& space, const std::int32_t* leaf) {
  std::uint64_t upper = 0;
  std::uint32_t lower = 0, place = 0;
  for (int axis = 0; axis < 3; ++axis) {
    upper = upper * space.size[axis] + static_cast<std::uint32_t>((leaf[axis] >> 9) - space.low[axis]);
    lower = lower << 5 | (static_cast<std::uint32_t>(leaf[axis]) >> 4 & 31);
    place = place << 4 | (static_cast<std::uint32_t>(leaf[axis]) & 15);
  }
  return upper << LeafKeys::kUpperShift | std::uint64_t{lower} << LeafKeys::kLowerShift | place;
}

/// @return lowest voxel of the leaf with this key
ACCESSVDB_HOSTDEV inline nanovdb::Coord originOf(const LeafKeys& space, std::uint64_t key) {
  const auto upper = static_cast<std::uint32_t>(key >> LeafKeys::kUpperShift);
  const std::uint32_t of_axis[3] = {upper / space.size[2] / space.size[1], upper / space.size[2] % space.size[1],
                                    upper % space.size[2]};
  nanovdb::Coord ijk;
  for (int axis = 0; axis < 3; ++axis) {
    const auto lower = static_cast<std::int32_t>(key >> (LeafKeys::kLowerShift + 10 - 5 * axis) & 31);
    const auto place = static_cast<std::int32_t>(key >> (8 - 4 * axis) & 15);
    ijk[axis] = (space.low[axis] + static_cast<std::int32_t>(of_axis[axis])) * 4096 + lower * 128 + place * 8;
  }
  return ijk;
}

}  // namespace accessvdb::kernels
