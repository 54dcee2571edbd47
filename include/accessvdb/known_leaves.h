// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// All that the map knows of space, leaf by leaf: for maps of other programs.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "accessvdb/export.h"
#include "accessvdb/leaf_change.h"

namespace accessvdb {

class AccessibilityField;

/// 8^3 voxels. The centre of voxel ijk is at origin_W() + ijk * voxel_size_m.
struct KnownLeaf {
  std::array<std::int32_t, 3> origin_ijk = {};  ///< least voxel, multiples of 8
  LeafBits collides = {};  ///< observed closer than r_c to a surface, or a return was left out there
  LeafBits free = {};      ///< seen to be free; what is neither is unknown
};

/// Leaves of which something is known; of all others nothing is. In order of their places: the same field gives the
/// same order.
ACCESSVDB_API void forEachKnownLeaf(const AccessibilityField& field,
                                    const std::function<void(const KnownLeaf& leaf)>& visit);

}  // namespace accessvdb
