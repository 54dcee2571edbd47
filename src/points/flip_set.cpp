// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "points/flip_set.h"

#include <algorithm>
#include <bit>

namespace accessvdb::internal {
namespace {

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

bool any(const LeafBits& bits) {
  std::uint64_t all = 0;
  for (const std::uint64_t word : bits) all |= word;
  return all != 0;
}

constexpr std::uint8_t bitOf(FlipKind kind) { return static_cast<std::uint8_t>(1u << static_cast<unsigned>(kind)); }

const LeafBits& bitsOf(const LeafChange& change, FlipKind kind) {
  switch (kind) {
    case FlipKind::CollidesOn:
      return change.collides_on;
    case FlipKind::CollidesOff:
      return change.collides_off;
    case FlipKind::ArmFreeOn:
      return change.arm_free_on;
    case FlipKind::ArmFreeOff:
      break;
  }
  return change.arm_free_off;
}

std::uint8_t kindsOf(const LeafChange& change) {
  std::uint8_t kinds = 0;
  for (const FlipKind kind : {FlipKind::CollidesOn, FlipKind::CollidesOff, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff}) {
    if (any(bitsOf(change, kind))) kinds |= bitOf(kind);
  }
  return kinds;
}

}  // namespace

std::size_t FlipSet::slotOf(const Index3& leaf) const {
  std::size_t slot = mix(leaf) & (slots_.size() - 1);
  while (slots_[slot].kinds != 0 && slots_[slot].leaf != leaf) slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

void FlipSet::grow(std::size_t capacity) {
  std::vector<Slot> old(capacity, Slot{{0, 0, 0}, 0, 0});
  old.swap(slots_);
  for (const Slot& slot : old) {
    if (slot.kinds != 0) slots_[slotOf(slot.leaf)] = slot;
  }
}

void FlipSet::add(std::span<const LeafChange> changes) {
  const std::size_t needed = std::bit_ceil(2 * (changes_.size() + changes.size()) + 16);
  if (slots_.size() < needed) grow(needed);
  for (const LeafChange& change : changes) {
    const Index3 leaf = parentOf(change.origin_ijk);
    const std::uint8_t kinds = kindsOf(change);
    if (kinds == 0) continue;
    Slot& slot = slots_[slotOf(leaf)];
    if (slot.kinds == 0) {
      changes_.push_back(change);
      slot = {leaf, static_cast<std::uint32_t>(changes_.size() - 1) & 0xfffffffu, kinds};
      continue;
    }
    slot.kinds = (slot.kinds | kinds) & 0xfu;
    LeafChange& known = changes_[slot.change];
    join(known.collides_on, change.collides_on);
    join(known.collides_off, change.collides_off);
    join(known.arm_free_on, change.arm_free_on);
    join(known.arm_free_off, change.arm_free_off);
  }
}

void FlipSet::clear() {
  if (changes_.empty()) return;
  changes_.clear();
  std::fill(slots_.begin(), slots_.end(), Slot{{0, 0, 0}, 0, 0});
}

std::uint8_t FlipSet::kindsIn(const Index3& leaf) const {
  return changes_.empty() ? std::uint8_t{0} : static_cast<std::uint8_t>(slots_[slotOf(leaf)].kinds);
}

const LeafBits* FlipSet::find(const Index3& leaf, FlipKind kind) const {
  if (changes_.empty()) return nullptr;
  const Slot& slot = slots_[slotOf(leaf)];
  return (slot.kinds & bitOf(kind)) == 0 ? nullptr : &bitsOf(changes_[slot.change], kind);
}

}  // namespace accessvdb::internal
