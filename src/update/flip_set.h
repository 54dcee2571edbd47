// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The facts that flipped since the last update, by leaf.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "points/place_map.h"
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

/// bitOf() of each kind of flip in the leaf.
[[nodiscard]] std::uint8_t kindsOf(const LeafChange& change);

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
  /// Calls visit(leaf, index into changes(), kinds) for each leaf of a box, inclusive, in which something flipped.
  /// @return whether there is any
  template <typename Visit>
  bool forEachIn(const Index3& low, const Index3& high, const Visit& visit) const;
  [[nodiscard]] const std::vector<LeafChange>& changes() const { return changes_; }
  [[nodiscard]] std::uint64_t bytes() const {
    return changes_.capacity() * sizeof(LeafChange) + kinds_.capacity() + leaf_groups_.capacity() * sizeof(LeafGroup) +
           leaf_group_of_.bytes();
  }

 private:
  /// 8 x 8 x 8 leaves.
  struct LeafGroup {
    LeafBits present = {};
    std::array<std::uint32_t, 512> change;  ///< index into changes_, where present
  };

  std::vector<LeafChange> changes_;
  std::vector<std::uint8_t> kinds_;  ///< of changes_
  std::vector<LeafGroup> leaf_groups_;
  PlaceMap leaf_group_of_;
};

inline FlipSet::Flipped FlipSet::at(const Index3& leaf) const {
  if (changes_.empty()) return {nullptr, 0};
  const std::uint32_t leaf_group = leaf_group_of_.find(parentOf(leaf));
  if (leaf_group == PlaceMap::kAbsent) return {nullptr, 0};
  const std::size_t bit = bitInParent(leaf);
  if ((leaf_groups_[leaf_group].present[bit >> 6] >> (bit & 63) & 1u) == 0) return {nullptr, 0};
  const std::uint32_t change = leaf_groups_[leaf_group].change[bit];
  return {&changes_[change], kinds_[change]};
}

template <typename Visit>
bool FlipSet::forEachIn(const Index3& low, const Index3& high, const Visit& visit) const {
  bool any = false;
  for (std::int32_t cx = low[0] >> 3; cx <= high[0] >> 3; ++cx) {
    for (std::int32_t cy = low[1] >> 3; cy <= high[1] >> 3; ++cy) {
      for (std::int32_t cz = low[2] >> 3; cz <= high[2] >> 3; ++cz) {
        const std::uint32_t number = leaf_group_of_.find({cx, cy, cz});
        if (number == PlaceMap::kAbsent) continue;
        const LeafGroup& leaf_group = leaf_groups_[number];
        for (std::size_t bit = 0; bit < 512; ++bit) {
          const std::uint64_t left = leaf_group.present[bit >> 6] >> (bit & 63);
          if (left == 0) {
            bit |= 63;
            continue;
          }
          bit += static_cast<std::size_t>(std::countr_zero(left));
          const Index3 leaf = childOf({cx, cy, cz}, bit);
          bool inside = true;
          for (std::size_t axis = 0; axis < 3; ++axis) {
            inside = inside && leaf[axis] >= low[axis] && leaf[axis] <= high[axis];
          }
          if (!inside) continue;
          any = true;
          visit(leaf, leaf_group.change[bit], kinds_[leaf_group.change[bit]]);
        }
      }
    }
  }
  return any;
}

}  // namespace accessvdb::internal
