// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/known_leaves.h"

#include <algorithm>
#include <vector>

#include "field/field_access.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb {

void forEachKnownLeaf(const AccessibilityField& field, const std::function<void(const KnownLeaf& leaf)>& visit) {
  const internal::PackedMap& map = internal::FieldAccess::map(field);
  std::vector<openvdb::Coord> origins;
  for (auto leaf = map.tree().cbeginLeaf(); leaf; ++leaf) origins.push_back(leaf->origin());
  for (const auto& [origin, voxels] : map.leftOut().inOrder()) origins.push_back(origin);
  std::sort(origins.begin(), origins.end());
  origins.erase(std::unique(origins.begin(), origins.end()), origins.end());
  internal::ConstPackedAccessor accessor(map.tree());
  constexpr auto kNone = [](std::uint64_t word) { return word == 0; };
  for (const openvdb::Coord& origin : origins) {
    const auto facts = internal::factsAt(map, accessor, origin);
    if (!facts) continue;
    const KnownLeaf leaf = {{origin.x(), origin.y(), origin.z()}, facts->collides_on, facts->arm_free_on};
    if (std::ranges::all_of(leaf.collides, kNone) && std::ranges::all_of(leaf.free, kNone)) continue;
    visit(leaf);
  }
}

}  // namespace accessvdb
