// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Voxels that a person takes out of the map (docs/design/change.md, "By hand").
///
///   Unknown  mean kept, weight 1; voxels that votes block keep so many that one denial frees them. No fact flips.
///   Free     weight 0, cleared, no votes
///
/// Only observed voxels are concerned: what was never seen stays unknown.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

/// Voxels of one leaf.
struct LeafVoxels {
  openvdb::Coord origin_ijk;  ///< lowest voxel of the leaf
  LeafBits bits = {};
};
/// Leaves in ascending order, each once, with at least one voxel.
using VoxelSet = std::vector<LeafVoxels>;

[[nodiscard]] std::uint64_t countBits(const LeafBits& bits);
[[nodiscard]] std::uint64_t countVoxels(const VoxelSet& voxels);
/// Voxels of which any fact flips.
[[nodiscard]] std::uint64_t flippedVoxels(const LeafChange& change);
/// Voxels that are in either.
[[nodiscard]] VoxelSet unionOf(const VoxelSet& a, const VoxelSet& b);
[[nodiscard]] bool contains(const VoxelSet& voxels, const openvdb::Coord& ijk);

/// Calls take(distances) for all leaves with values, in parts, as changes of an empty mirror.
void forEachDistanceLeaf(const PackedMap& map,
                         const std::function<void(std::span<const DistanceChange> distances)>& take);

/// What would flip if these observed voxels became free: only for the better. Leaves without a flip are left out.
[[nodiscard]] std::vector<LeafChange> flipsIfFree(const PackedMap& map, const VoxelSet& voxels);

/// @param voxels  observed  @return the leaves with flips, none for Unknown
std::vector<LeafChange> removeAsUnknown(PackedMap& map, const VoxelSet& voxels);
std::vector<LeafChange> removeAsFree(PackedMap& map, const VoxelSet& voxels);

}  // namespace accessvdb::internal
