// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A set of leaves that rays look up on their way, 8^3 leaves at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "points/cell_map.h"
#include "points/surface_index.h"
#include "tsdf/leaf_bits.h"

namespace accessvdb::internal {

class LeafFlags {
 public:
  /// @param leaf  voxel index >> 3
  void add(const Index3& leaf) {
    const auto [number, is_new] = cell_of_.insert(parentOf(leaf), static_cast<std::uint32_t>(cells_.size()));
    if (is_new) {
      cells_.emplace_back();
      places_.push_back(parentOf(leaf));
    }
    const std::size_t bit = bitInParent(leaf);
    cells_[number][bit >> 6] |= std::uint64_t{1} << (bit & 63);
  }
  void clear() {
    if (cells_.empty()) return;
    cells_.clear();
    places_.clear();
    cell_of_ = CellMap();
  }
  [[nodiscard]] bool empty() const { return cells_.empty(); }

  /// @param visit  (leaf)
  template <typename Visit>
  void forEach(const Visit& visit) const {
    for (std::size_t number = 0; number < cells_.size(); ++number) {
      forEachBit(cells_[number], [&](std::size_t bit) { visit(childOf(places_[number], bit)); });
    }
  }

  /// The leaves of a cell, one bit each; nullptr if there is none. @param cell  leaf >> 3
  [[nodiscard]] const LeafBits* in(const Index3& cell) const {
    const std::uint32_t number = cell_of_.find(cell);
    return number == CellMap::kNoCell ? nullptr : &cells_[number];
  }
  [[nodiscard]] std::uint64_t bytes() const {
    return cells_.capacity() * sizeof(LeafBits) + places_.capacity() * sizeof(Index3) + cell_of_.bytes();
  }

 private:
  CellMap cell_of_;
  std::vector<LeafBits> cells_;
  std::vector<Index3> places_;  ///< of the cells
};

}  // namespace accessvdb::internal
