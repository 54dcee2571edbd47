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

class FlipSet {
 public:
  /// Joins with what is there: a voxel that flips to and fro counts as flipped both ways, which costs work but is safe.
  void add(std::span<const LeafChange> changes);
  void clear();
  [[nodiscard]] bool empty() const { return changes_.empty(); }

  /// @param leaf  voxel index >> 3. @return nullptr where nothing flipped
  [[nodiscard]] const LeafChange* find(const Index3& leaf) const;
  [[nodiscard]] std::uint64_t bytes() const {
    return changes_.capacity() * sizeof(LeafChange) + slots_.capacity() * sizeof(std::uint32_t);
  }

 private:
  [[nodiscard]] std::size_t slotOf(const Index3& leaf) const;
  void rehash(std::size_t capacity);

  std::vector<LeafChange> changes_;
  std::vector<std::uint32_t> slots_;  ///< open addressing, index into changes_ or kNone
};

}  // namespace accessvdb::internal
