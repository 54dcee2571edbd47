// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/known_leaves.h"

#include <algorithm>

#include "field/field_access.h"
#include "field/query/known_space.h"
#include "tsdf/leaf_facts.h"

namespace accessvdb {

void forEachKnownLeaf(const AccessibilityField& field, const std::function<void(const KnownLeaf& leaf)>& visit) {
  const internal::PackedMap& map = internal::FieldAccess::map(field);
  internal::ConstPackedAccessor accessor(map.tree());
  constexpr auto kNone = [](std::uint64_t word) { return word == 0; };
  for (const openvdb::Coord& origin : internal::knownLeafOrigins(map)) {
    const auto facts = internal::factsAt(map, accessor, origin);
    if (!facts) continue;
    const KnownLeaf leaf = {{origin.x(), origin.y(), origin.z()}, facts->collides_on, facts->arm_free_on};
    if (std::ranges::all_of(leaf.collides, kNone) && std::ranges::all_of(leaf.free, kNone)) continue;
    visit(leaf);
  }
}

}  // namespace accessvdb
