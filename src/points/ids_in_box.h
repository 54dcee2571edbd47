// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The points of a block that are in a box of voxels.
#pragma once

#include <bit>
#include <cstdint>

#include "hostdev/box_in_leaf.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

/// Calls visit(id) for the points of a block that are in a box of voxels. @param low, high  inclusive
template <typename Visit>
void forEachIdInBox(const PointBlock& block, const Index3& low, const Index3& high, const Visit& visit) {
  const kernels::BoxInLeaf box(block.leaf.data(), low.data(), high.data());
  const std::uint32_t* id = block.ids.data();  // of the next set bit
  for (int x = 0; x <= box.lastX(); ++x) {
    const std::uint64_t occupied = block.occupied[static_cast<std::size_t>(x)], wanted = occupied & box.wordAt(x);
    if (wanted == 0) {
      id += std::popcount(occupied);
      continue;
    }
    // There are only a few bits, so going through them is faster than counting those below each one.
    for (std::uint64_t bits = occupied; bits != 0; bits &= bits - 1, ++id) {
      if ((wanted & bits & -bits) != 0) visit(*id);
    }
  }
}

}  // namespace accessvdb::internal
