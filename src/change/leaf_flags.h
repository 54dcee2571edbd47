// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A set of leaves that rays look up on their way, 8^3 leaves at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "points/place_map.h"
#include "points/surface_index.h"
#include "tsdf/leaf_bits.h"

namespace accessvdb::internal {

class LeafFlags {
 public:
  /// @param leaf  voxel index >> 3
  void add(const Index3& leaf) {
    const auto [number, is_new] =
        leaf_group_of_.insert(parentOf(leaf), static_cast<std::uint32_t>(leaf_groups_.size()));
    if (is_new) {
      leaf_groups_.emplace_back();
      places_.push_back(parentOf(leaf));
    }
    const std::size_t bit = bitInParent(leaf);
    leaf_groups_[number][bit >> 6] |= std::uint64_t{1} << (bit & 63);
  }
  void clear() {
    if (leaf_groups_.empty()) return;
    leaf_groups_.clear();
    places_.clear();
    leaf_group_of_ = PlaceMap();
  }
  [[nodiscard]] bool empty() const { return leaf_groups_.empty(); }

  /// @param visit  (leaf)
  template <typename Visit>
  void forEach(const Visit& visit) const {
    for (std::size_t number = 0; number < leaf_groups_.size(); ++number) {
      forEachBit(leaf_groups_[number], [&](std::size_t bit) { visit(childOf(places_[number], bit)); });
    }
  }

  /// The leaves of a leaf group, one bit each; nullptr if there is none. @param leaf_group  leaf >> 3
  [[nodiscard]] const LeafBits* in(const Index3& leaf_group) const {
    const std::uint32_t number = leaf_group_of_.find(leaf_group);
    return number == PlaceMap::kAbsent ? nullptr : &leaf_groups_[number];
  }
  [[nodiscard]] std::uint64_t bytes() const {
    return leaf_groups_.capacity() * sizeof(LeafBits) + places_.capacity() * sizeof(Index3) + leaf_group_of_.bytes();
  }

 private:
  PlaceMap leaf_group_of_;
  std::vector<LeafBits> leaf_groups_;
  std::vector<Index3> places_;  ///< of the leaf groups
};

}  // namespace accessvdb::internal
