// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Free space ages: what no ray has confirmed for T to 2 T is unknown again
/// (docs/design/change.md, "Free space that ages").
///
/// Time is cut into generations of length T. A leaf has two masks: the voxels that a ray has confirmed to be free in
/// this generation (*now*, the active bits of the leaf), and those of the generation before (*before*, in a record
/// beside the map). A voxel counts as free while it is in one of them. When a generation ends, *now* moves into
/// *before* and starts empty again: after two generations without a ray, the voxel is unknown.
///
/// All leaves of a node of the tree (128^3 voxels) turn together; when, depends on the node's coordinates and on the
/// stamps of the scans alone, spread over T so that no scan turns everything. Ages take freedom away, nothing else:
/// collisions, surfaces and confidence do not age.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"
#include "tsdf/record_pool.h"

namespace accessvdb::internal {

class PackedMap;

/// What a leaf of a map that ages has beside its node; leaves without have neither.
struct AgedLeaf {
  LeafBits before = {};     ///< free in the generation before this one
  std::uint32_t votes = 0;  ///< number of its votes; 0: none

  [[nodiscard]] bool any() const {
    std::uint64_t all = votes;
    for (const std::uint64_t word : before) all |= word;
    return all != 0;
  }
};

class FreeGenerations {
 public:
  /// @param free_for_s  [T] > 0, finite
  explicit FreeGenerations(double free_for_s) : free_for_s_(free_for_s) {}

  /// Lets time pass, at most 2 T: after that, nothing of what was confirmed before is left. NaN and what is not
  /// positive counts as 0.
  /// @return the leaves in which voxels are no longer free, each at most once, in at most kLists lists; valid until the
  ///         next call
  std::vector<std::span<const LeafChange>> pass(PackedMap& map, double seconds) {
    return passTo(map, ageAfter(seconds));
  }
  /// The same until this age. Nothing happens at an earlier one.
  std::vector<std::span<const LeafChange>> passTo(PackedMap& map, double age_s);
  /// Whether leaves of the map turn until this age.
  [[nodiscard]] bool isDue(const PackedMap& map, double age_s) const;
  /// age_s() after so many seconds more.
  [[nodiscard]] double ageAfter(double seconds) const;
  static constexpr std::size_t kLists = 64;

  /// Which generation a node is in. @param x, y, z  its lowest voxel, multiples of 128
  [[nodiscard]] std::int64_t generationOf(std::int32_t x, std::int32_t y, std::int32_t z) const {
    return generationAt(age_s_, x, y, z);
  }

  /// Time that has passed since the first stamp, with each step at most 2 T. Part of a saved state.
  [[nodiscard]] double age_s() const { return age_s_; }
  void restoreAge(double age_s) { age_s_ = age_s; }

  [[nodiscard]] RecordPool<AgedLeaf>& records() { return records_; }
  [[nodiscard]] const RecordPool<AgedLeaf>& records() const { return records_; }

 private:
  [[nodiscard]] std::int64_t generationAt(double age_s, std::int32_t x, std::int32_t y, std::int32_t z) const;

  double free_for_s_, age_s_ = 0;
  RecordPool<AgedLeaf> records_;
  std::array<std::vector<LeafChange>, kLists> changes_;  ///< kept so that memory is reused
};

}  // namespace accessvdb::internal
