// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Which side of a narrow band the space beyond it is on.
#pragma once

#include <vector>

#include "vdb/standard_grids.h"

namespace accessvdb::internal {

/// Gives every inactive voxel of the leaves the value +background or -background.
///
/// Active voxels with |value| < layer divide space into connected regions (over faces; missing leaves are free space).
/// A region that reaches infinity is outside; any other is on the side of the majority of its other active voxels.
/// @param leaves  in any order, one per position; each active voxel's face neighbours must be in a leaf
void signInactiveVoxels(const std::vector<openvdb::FloatTree::LeafNodeType*>& leaves, float layer, float background);

}  // namespace accessvdb::internal
