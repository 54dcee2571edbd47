// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The two facts that scoring reads, of a whole leaf: for a mirror that has to be made from an existing map.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "accessvdb/distance_change.h"
#include "accessvdb/leaf_change.h"
#include "tsdf/packed_map.h"

namespace accessvdb::internal {

/// What would have to flip if the leaf were new: collides_on and arm_free_on are its facts.
[[nodiscard]] LeafChange factsOf(const PackedMap& map, const PackedLeaf& leaf);
/// The same, with what was left out in it (LeftOutVoxels).
[[nodiscard]] LeafChange factsWithLeftOut(const PackedMap& map, const PackedLeaf& leaf);

/// Those of a place where there may be no leaf, but something left out; nothing where there is neither.
/// @param accessor  of the map's tree
[[nodiscard]] std::optional<LeafChange> factsAt(const PackedMap& map, ConstPackedAccessor& accessor,
                                                const openvdb::Coord& origin_ijk);

/// factsOf() of leaves, without those that have none. @param facts  out; its memory is used again
void factsOf(const PackedMap& map, std::span<const PackedLeaf* const> leaves, std::vector<LeafChange>& facts);
/// Calls take() with the facts of all leaves that have any, some at a time.
void forEachPartOfFacts(const PackedMap& map, const std::function<void(std::span<const LeafChange> facts)>& take);

/// Of all voxels of a leaf, those that were observed.
[[nodiscard]] LeafBits observedIn(const PackedLeaf& leaf);

/// All distances of a leaf, as if each had changed. @param leaf  has values  @param room  must live as long as the
/// result
[[nodiscard]] DistanceChange distancesOf(const PackedMap& map, const PackedLeaf& leaf, LeafValues::Room& room);

}  // namespace accessvdb::internal
