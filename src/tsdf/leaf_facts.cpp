// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tsdf/leaf_facts.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

namespace accessvdb::internal {
namespace {

/// @return whether one of the facts holds anywhere
bool hasFacts(const LeafChange& facts) {
  std::uint64_t any = 0;
  for (std::size_t x = 0; x < 8; ++x) any |= facts.collides_on[x] | facts.arm_free_on[x];
  return any != 0;
}

}  // namespace

LeafChange factsOf(const PackedMap& map, const PackedLeaf& leaf) {
  const LeafBits observed = observedIn(leaf), confirmed = map.confirmedIn(leaf);
  const openvdb::Coord& origin = leaf.origin();
  LeafChange facts;
  facts.origin_ijk = {origin.x(), origin.y(), origin.z()};
  facts.collides_on = map.collidingIn(leaf);
  for (std::size_t x = 0; x < 8; ++x) {
    const std::uint64_t free = ~facts.collides_on[x];
    facts.arm_free_on[x] =
        map.agesFreeSpace() ? confirmed[x] & free : (observed[x] & free) | (confirmed[x] & ~observed[x]);
  }
  return facts;
}

LeafChange factsWithLeftOut(const PackedMap& map, const PackedLeaf& leaf) {
  LeafChange facts = factsOf(map, leaf);
  if (map.leftOut().empty()) return facts;
  const LeafBits* left_out = map.leftOut().find(leaf.origin());
  for (std::size_t x = 0; left_out != nullptr && x < 8; ++x) {
    facts.collides_on[x] |= (*left_out)[x];
    facts.arm_free_on[x] &= ~(*left_out)[x];
  }
  return facts;
}

std::optional<LeafChange> factsAt(const PackedMap& map, ConstPackedAccessor& accessor,
                                  const openvdb::Coord& origin_ijk) {
  if (const PackedLeaf* leaf = accessor.probeConstLeaf(origin_ijk)) return factsWithLeftOut(map, *leaf);
  const LeafBits* left_out = map.leftOut().find(origin_ijk);
  if (left_out == nullptr) return std::nullopt;
  LeafChange facts = {};
  facts.origin_ijk = {origin_ijk.x(), origin_ijk.y(), origin_ijk.z()};
  facts.collides_on = *left_out;
  return facts;
}

void factsOf(const PackedMap& map, std::span<const PackedLeaf* const> leaves, std::vector<LeafChange>& facts) {
  constexpr std::size_t kLeavesPerTask = 64;
  facts.resize(leaves.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, leaves.size(), kLeavesPerTask), [&](const auto& range) {
    for (std::size_t n = range.begin(); n != range.end(); ++n) facts[n] = factsOf(map, *leaves[n]);
  });
  std::erase_if(facts, [](const LeafChange& change) { return !hasFacts(change); });
}

void forEachPartOfFacts(const PackedMap& map, const std::function<void(std::span<const LeafChange> facts)>& take) {
  constexpr std::size_t kLeavesPerPart = std::size_t{1} << 16;
  std::vector<const PackedLeaf*> leaves;
  map.tree().getNodes(leaves);
  std::vector<LeafChange> facts;
  for (std::size_t first = 0; first < leaves.size(); first += kLeavesPerPart) {
    factsOf(map, std::span(leaves).subspan(first, std::min(leaves.size() - first, kLeavesPerPart)), facts);
    take(facts);
  }
}

LeafBits observedIn(const PackedLeaf& leaf) {
  LeafBits observed = {};
  LeafValues::Room room;
  const std::uint32_t* packed = LeafValues(leaf).all(room);
  for (std::size_t n = 0; packed != nullptr && n < PackedLeaf::SIZE; ++n) {
    observed[n >> 6] |= std::uint64_t{weightOf(packed[n]) > 0 ? 1u : 0u} << (n & 63);
  }
  return observed;
}

DistanceChange distancesOf(const PackedMap& map, const PackedLeaf& leaf, LeafValues::Room& room) {
  constexpr std::uint32_t kAllRowPairs = ~std::uint32_t{0};
  const openvdb::Coord& origin = leaf.origin();
  return {{origin.x(), origin.y(), origin.z()}, kAllRowPairs, LeafValues(leaf).all(room), map.blockedIn(leaf)};
}

}  // namespace accessvdb::internal
