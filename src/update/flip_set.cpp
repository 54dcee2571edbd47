// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/flip_set.h"

namespace accessvdb::internal {
namespace {

void join(LeafBits& into, const LeafBits& from) {
  for (std::size_t n = 0; n < 8; ++n) into[n] |= from[n];
}

bool any(const LeafBits& bits) {
  std::uint64_t all = 0;
  for (const std::uint64_t word : bits) all |= word;
  return all != 0;
}

}  // namespace

std::uint8_t kindsOf(const LeafChange& change) {
  std::uint8_t kinds = 0;
  for (const FlipKind kind : {FlipKind::CollidesOn, FlipKind::CollidesOff, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff}) {
    if (any(bitsOf(change, kind))) kinds |= bitOf(kind);
  }
  return kinds;
}

void FlipSet::add(std::span<const LeafChange> changes) {
  for (const LeafChange& change : changes) {
    const std::uint8_t kinds = kindsOf(change);
    if (kinds == 0) continue;
    const Index3 leaf = parentOf(change.origin_ijk);
    const auto [number, is_new] =
        leaf_group_of_.insert(parentOf(leaf), static_cast<std::uint32_t>(leaf_groups_.size()));
    if (is_new) leaf_groups_.emplace_back();
    LeafGroup& leaf_group = leaf_groups_[number];
    const std::size_t bit = bitInParent(leaf);
    std::uint64_t& present = leaf_group.present[bit >> 6];
    const std::uint64_t own = std::uint64_t{1} << (bit & 63);
    if ((present & own) == 0) {
      present |= own;
      leaf_group.change[bit] = static_cast<std::uint32_t>(changes_.size());
      changes_.push_back(change);
      kinds_.push_back(kinds);
      continue;
    }
    LeafChange& known = changes_[leaf_group.change[bit]];
    std::uint8_t& known_kinds = kinds_[leaf_group.change[bit]];
    known_kinds = static_cast<std::uint8_t>(known_kinds | kinds);
    join(known.collides_on, change.collides_on);
    join(known.collides_off, change.collides_off);
    join(known.arm_free_on, change.arm_free_on);
    join(known.arm_free_off, change.arm_free_off);
  }
}

void FlipSet::clear() {
  if (changes_.empty()) return;
  changes_.clear();
  kinds_.clear();
  leaf_groups_.clear();
  leaf_group_of_ = PlaceMap();
}

}  // namespace accessvdb::internal
