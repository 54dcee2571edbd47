// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/flip_set.h"

#include <bit>

namespace accessvdb::internal {
namespace {

Index3 leafOf(const LeafChange& change) { return parentOf(change.origin_ijk); }

std::uint64_t mix(const Index3& leaf) {
  std::uint64_t h = static_cast<std::uint32_t>(leaf[0]);
  h = (h * 0x9e3779b97f4a7c15ull) ^ static_cast<std::uint32_t>(leaf[1]);
  h = (h * 0x9e3779b97f4a7c15ull) ^ static_cast<std::uint32_t>(leaf[2]);
  h *= 0x9e3779b97f4a7c15ull;
  return h ^ h >> 32;
}

void join(LeafBits& into, const LeafBits& from) {
  for (std::size_t n = 0; n < 8; ++n) into[n] |= from[n];
}

}  // namespace

std::size_t FlipSet::slotOf(const Index3& leaf) const {
  std::size_t slot = mix(leaf) & (slots_.size() - 1);
  while (slots_[slot] != kNone && leafOf(changes_[slots_[slot]]) != leaf) slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

void FlipSet::rehash(std::size_t capacity) {
  slots_.assign(capacity, kNone);
  for (std::uint32_t n = 0; n < changes_.size(); ++n) slots_[slotOf(leafOf(changes_[n]))] = n;
}

void FlipSet::add(std::span<const LeafChange> changes) {
  const std::size_t needed = std::bit_ceil(2 * (changes_.size() + changes.size()) + 16);
  if (slots_.size() < needed) rehash(needed);
  for (const LeafChange& change : changes) {
    const std::size_t slot = slotOf(leafOf(change));
    if (slots_[slot] == kNone) {
      slots_[slot] = static_cast<std::uint32_t>(changes_.size());
      changes_.push_back(change);
      continue;
    }
    LeafChange& known = changes_[slots_[slot]];
    join(known.collides_on, change.collides_on);
    join(known.collides_off, change.collides_off);
    join(known.arm_free_on, change.arm_free_on);
    join(known.arm_free_off, change.arm_free_off);
  }
}

void FlipSet::clear() {
  if (changes_.empty()) return;
  changes_.clear();
  std::fill(slots_.begin(), slots_.end(), kNone);
}

const LeafChange* FlipSet::find(const Index3& leaf) const {
  if (changes_.empty()) return nullptr;
  const std::uint32_t n = slots_[slotOf(leaf)];
  return n == kNone ? nullptr : &changes_[n];
}

}  // namespace accessvdb::internal
