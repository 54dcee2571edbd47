// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The facts that flipped since the last update, by leaf.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

/// The four ways a fact can flip.
enum class FlipKind : std::uint8_t { CollidesOn, CollidesOff, ArmFreeOn, ArmFreeOff };
inline constexpr int kFlipKinds = 4;

class FlipSet {
 public:
  /// Joins with what is there: a voxel that flips to and fro counts as flipped both ways, which costs work but is safe.
  void add(std::span<const LeafChange> changes);
  void clear();
  [[nodiscard]] bool empty() const { return changes_.empty(); }

  /// @param leaf  voxel index >> 3. @return bit (1 << kind) for each kind of flip in the leaf; 0 where nothing flipped
  [[nodiscard]] std::uint8_t kindsIn(const Index3& leaf) const;
  /// Voxels of the leaf with a flip of that kind, or nullptr where there is none.
  [[nodiscard]] const LeafBits* find(const Index3& leaf, FlipKind kind) const;
  [[nodiscard]] const std::vector<LeafChange>& changes() const { return changes_; }
  [[nodiscard]] std::uint64_t bytes() const {
    return changes_.capacity() * sizeof(LeafChange) + slots_.capacity() * sizeof(Slot);
  }

 private:
  /// Open addressing. Key and kinds lie in the slot, so that most questions never touch the bits themselves.
  struct Slot {
    Index3 leaf;
    std::uint32_t change : 28;  ///< index into changes_
    std::uint32_t kinds : 4;    ///< 0: the slot is empty
  };
  [[nodiscard]] std::size_t slotOf(const Index3& leaf) const;
  void grow(std::size_t capacity);

  std::vector<LeafChange> changes_;
  std::vector<Slot> slots_;
};

}  // namespace accessvdb::internal
