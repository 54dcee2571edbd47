// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "update/flip_set.h"

#include <algorithm>
#include <bit>

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

std::uint8_t kindsOf(const LeafChange& change) {
  std::uint8_t kinds = 0;
  for (const FlipKind kind : {FlipKind::CollidesOn, FlipKind::CollidesOff, FlipKind::ArmFreeOn, FlipKind::ArmFreeOff}) {
    if (any(bitsOf(change, kind))) kinds |= bitOf(kind);
  }
  return kinds;
}

}  // namespace

void FlipSet::grow(std::size_t capacity) {
  std::vector<Slot> old(capacity, Slot{0, 0, 0});
  old.swap(slots_);
  for (const Slot& slot : old) {
    if (slot.kinds != 0) slots_[slotOf(slot.key)] = slot;
  }
}

void FlipSet::add(std::span<const LeafChange> changes) {
  const std::size_t needed = std::bit_ceil(2 * (changes_.size() + changes.size()) + 16);
  if (slots_.size() < needed) grow(needed);
  for (const LeafChange& change : changes) {
    const Index3 leaf = parentOf(change.origin_ijk);
    const std::uint64_t key = kernels::placeKey(leaf[0], leaf[1], leaf[2]);
    const std::uint8_t kinds = kindsOf(change);
    if (kinds == 0) continue;
    Slot& slot = slots_[slotOf(key)];
    if (slot.kinds == 0) {
      changes_.push_back(change);
      slot = {key, static_cast<std::uint32_t>(changes_.size() - 1), kinds};
      continue;
    }
    slot.kinds |= kinds;
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
  std::fill(slots_.begin(), slots_.end(), Slot{0, 0, 0});
}

bool FlipWindow::fill(const FlipSet& flips, const Index3& low, const Index3& high) {
  low_ = low;
  std::size_t count = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    extent_[axis] = static_cast<std::uint32_t>(high[axis] - low[axis] + 1);
    count *= extent_[axis];
  }
  changes_.resize(count);
  kinds_.resize(count);
  std::size_t n = 0;
  std::uint8_t any_kind = 0;
  for (std::int32_t x = low[0]; x <= high[0]; ++x) {
    for (std::int32_t y = low[1]; y <= high[1]; ++y) {
      for (std::int32_t z = low[2]; z <= high[2]; ++z, ++n) {
        const FlipSet::Flipped flipped = flips.at({x, y, z});
        changes_[n] = flipped.change;
        kinds_[n] = flipped.kinds;
        any_kind |= flipped.kinds;
      }
    }
  }
  return any_kind != 0;
}

}  // namespace accessvdb::internal
