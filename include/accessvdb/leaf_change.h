// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What changed in one leaf of the map, in the two facts that scoring needs.
#pragma once

#include <array>
#include <cstdint>

namespace accessvdb {

/// 512 bits of an 8x8x8 leaf in OpenVDB order: bit (x&7)<<6 | (y&7)<<3 | (z&7); so word x&7, byte y&7, bit z&7.
using LeafBits = std::array<std::uint64_t, 8>;

/// Voxels of one leaf whose facts flipped.
///   collides: observed and not (distance >= r_c)              tool test: unknown is free
///   arm_free: observed and distance >= r_c, or cleared and unobserved   arm test: unknown is blocked
/// "worse" flips can only take accessibility away (collides 0->1, arm_free 1->0), "better" ones can only give it.
struct LeafChange {
  std::array<std::int32_t, 3> origin_ijk = {};  ///< least voxel of the leaf, multiples of 8
  LeafBits collides_on = {};                    ///< worse
  LeafBits collides_off = {};                   ///< better
  LeafBits arm_free_on = {};                    ///< better
  LeafBits arm_free_off = {};                   ///< worse
};

}  // namespace accessvdb
