// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The facts that flipped since the last update, by leaf.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "hostdev/place_key.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

/// The four ways a fact can flip.
enum class FlipKind : std::uint8_t { CollidesOn, CollidesOff, ArmFreeOn, ArmFreeOff };
inline constexpr int kFlipKinds = 4;

constexpr std::uint8_t bitOf(FlipKind kind) { return static_cast<std::uint8_t>(1u << static_cast<unsigned>(kind)); }

inline const LeafBits& bitsOf(const LeafChange& change, FlipKind kind) {
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

class FlipSet {
 public:
  /// Merges with existing entries: a voxel that flips back and forth counts as flipped both ways, which is safe but
  /// costs work.
  void add(std::span<const LeafChange> changes);
  void clear();
  [[nodiscard]] bool empty() const { return changes_.empty(); }

  /// @param leaf  voxel index >> 3. @return bit (1 << kind) for each kind of flip in the leaf; 0 if nothing flipped
  [[nodiscard]] std::uint8_t kindsIn(const Index3& leaf) const { return at(leaf).kinds; }
  /// Voxels of the leaf with a flip of that kind, or nullptr if there is none.
  [[nodiscard]] const LeafBits* find(const Index3& leaf, FlipKind kind) const {
    const Flipped flipped = at(leaf);
    return (flipped.kinds & bitOf(kind)) == 0 ? nullptr : &bitsOf(*flipped.change, kind);
  }
  /// Both of the above at once; valid until the set changes.
  struct Flipped {
    const LeafChange* change;  ///< nullptr if nothing flipped
    std::uint8_t kinds;
  };
  [[nodiscard]] Flipped at(const Index3& leaf) const;
  [[nodiscard]] const std::vector<LeafChange>& changes() const { return changes_; }
  [[nodiscard]] std::uint64_t bytes() const {
    return changes_.capacity() * sizeof(LeafChange) + slots_.capacity() * sizeof(Slot);
  }

 private:
  /// Open addressing. Key and kinds are in the slot, so most queries never touch the bits themselves.
  struct Slot {
    std::uint64_t key;
    std::uint32_t change;  ///< index into changes_
    std::uint32_t kinds;   ///< 0: the slot is empty
  };
  [[nodiscard]] std::size_t slotOf(std::uint64_t key) const;
  void grow(std::size_t capacity);

  std::vector<LeafChange> changes_;
  std::vector<Slot> slots_;  ///< size is a power of two
};

// Inline: a few hundred calls per point and update.

inline std::size_t FlipSet::slotOf(std::uint64_t key) const {
  std::uint64_t mixed = key * 0x9e3779b97f4a7c15ull;
  mixed ^= mixed >> 32;
  std::size_t slot = mixed & (slots_.size() - 1);
  while (slots_[slot].kinds != 0 && slots_[slot].key != key) slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

inline FlipSet::Flipped FlipSet::at(const Index3& leaf) const {
  if (changes_.empty()) return {nullptr, 0};
  const Slot& slot = slots_[slotOf(kernels::placeKey(leaf[0], leaf[1], leaf[2]))];
  if (slot.kinds == 0) return {nullptr, 0};
  return {&changes_[slot.change], static_cast<std::uint8_t>(slot.kinds)};
}

/// The part of a FlipSet in a box of leaves, stored by position, because the points of a block query the same leaves
/// repeatedly. Gives the same answers as the set inside the box; outside it reports no flips.
class FlipWindow {
 public:
  /// @param low, high  leaves, inclusive. @return false if nothing flipped in the box
  bool fill(const FlipSet& flips, const Index3& low, const Index3& high);
  [[nodiscard]] std::uint8_t kindsIn(const Index3& leaf) const {
    const std::size_t n = indexOf(leaf);
    return n < kinds_.size() ? kinds_[n] : std::uint8_t{0};
  }
  [[nodiscard]] const LeafBits* find(const Index3& leaf, FlipKind kind) const {
    const std::size_t n = indexOf(leaf);
    return n >= kinds_.size() || (kinds_[n] & bitOf(kind)) == 0 ? nullptr : &bitsOf(*changes_[n], kind);
  }

 private:
  /// Past the end if the leaf lies outside.
  [[nodiscard]] std::size_t indexOf(const Index3& leaf) const {
    const auto x = static_cast<std::uint32_t>(leaf[0] - low_[0]), y = static_cast<std::uint32_t>(leaf[1] - low_[1]);
    const auto z = static_cast<std::uint32_t>(leaf[2] - low_[2]);
    if (x >= extent_[0] || y >= extent_[1] || z >= extent_[2]) return kinds_.size();
    return (static_cast<std::size_t>(x) * extent_[1] + y) * extent_[2] + z;
  }

  Index3 low_ = {};
  std::array<std::uint32_t, 3> extent_ = {};
  std::vector<const LeafChange*> changes_;
  std::vector<std::uint8_t> kinds_;
};

}  // namespace accessvdb::internal
