// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The tree of the authored map (packed_map.h).
#pragma once

#include <openvdb/tree/Tree.h>
#include <openvdb/tree/ValueAccessor.h>

#include "tsdf/packed_voxel.h"

namespace accessvdb::internal {

using PackedTree = openvdb::tree::Tree4<PackedVoxel, 5, 4, 3>::Type;
using PackedLeaf = PackedTree::LeafNodeType;
using PackedUpperNode = PackedTree::RootNodeType::ChildNodeType;
using PackedLowerNode = PackedTree::RootNodeType::ChildNodeType::ChildNodeType;  ///< of 16^3 leaves
/// Caches inner nodes only. OpenVDB's default accessors also cache the leaf's buffer, and thereby allocate an
/// uninitialised one for leaves without, and take compact values for plain ones: never use them on this tree.
using PackedAccessor = openvdb::tree::ValueAccessor2<PackedTree, /*IsSafe=*/false, 1, 2>;
using ConstPackedAccessor = openvdb::tree::ValueAccessor2<const PackedTree, /*IsSafe=*/false, 1, 2>;
static_assert(PackedLeaf::LOG2DIM == 3, "masks and rows assume 8x8x8 leaves");

}  // namespace accessvdb::internal
