// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_facts.h"

namespace accessvdb::internal {

LeafChange factsOf(const PackedMap& map, const PackedLeaf& leaf) {
  const std::uint32_t collision_mean = map.collisionMean();
  const LeafBits blocked = map.blockedIn(leaf), confirmed = map.confirmedIn(leaf);
  const openvdb::Coord& origin = leaf.origin();
  LeafChange facts;
  facts.origin_ijk = {origin.x(), origin.y(), origin.z()};
  const std::uint32_t* packed = packedValues(leaf);
  for (std::size_t x = 0; x < 8; ++x) {
    std::uint64_t observed = 0, collides = 0;
    for (std::size_t n = 0; packed != nullptr && n < 64; ++n) {
      const std::uint32_t voxel = packed[64 * x + n];
      const std::uint64_t seen = weightOf(voxel) > 0 ? 1 : 0, near = meanOf(voxel) < collision_mean ? seen : 0;
      observed |= seen << n;
      collides |= near << n;
    }
    collides |= blocked[x];
    facts.collides_on[x] = collides;
    facts.arm_free_on[x] =
        map.agesFreeSpace() ? confirmed[x] & ~collides : (observed & ~collides) | (confirmed[x] & ~observed);
  }
  return facts;
}

}  // namespace accessvdb::internal
