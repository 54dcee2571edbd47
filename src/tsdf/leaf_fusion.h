// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Everything that one scan does to one leaf, summed in integers, then folded into the map once.
///
/// Integer sums do not depend on their order, and a fold happens once a scan: so the map is the same bit for bit for
/// every number of threads and every order of the points inside a scan.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "accessvdb/leaf_change.h"
#include "tsdf/packed_map.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// A return that reaches into a leaf: its index and which part of its region does.
struct LeafEntry {
  static constexpr std::uint32_t kBand = 1;
  std::uint32_t code = 0;  ///< index << 1 | kBand
  [[nodiscard]] std::uint32_t index() const { return code >> 1; }
  [[nodiscard]] bool band() const { return (code & kBand) != 0; }
};

/// Sums of one scan over the 512 voxels of a leaf. Lives in the first-level cache.
struct LeafSums {
  alignas(64) std::array<std::uint32_t, 512> distance;  ///< sum of samples in steps of kSampleSteps
  alignas(64) std::array<std::uint32_t, 512> counts;    ///< samples in the low half, passes of the band in the high half
};

/// Totals where more returns reach a leaf than LeafSums can hold.
struct WideSums {
  std::array<std::uint64_t, 512> distance = {};
  std::array<std::uint32_t, 512> samples = {}, passes = {};
};

/// Counts of one or many folds.
struct FoldCounts {
  std::uint64_t distance_updates = 0;
  std::uint64_t cleared_updates = 0;
  std::uint64_t newly_observed = 0;
};

class LeafFusion {
 public:
  LeafFusion(const PackedMap& map, const RegionShape& shape);

  /// Sums all entries of one leaf. @return false where no voxel of the leaf is reached
  bool accumulate(const std::array<std::int32_t, 3>& origin_ijk, std::span<const LeafEntry> entries,
                  const ReturnRay* rays);

  /// True when accumulate() found distance samples (else only band passes).
  [[nodiscard]] bool hasSamples() const { return has_samples_; }

  /// Folds the sums into the leaf. The leaf must have a buffer if hasSamples().
  /// @return true when a voxel's collides or arm_free flipped; then `change` says which
  bool fold(PackedLeaf& leaf, LeafChange& change, FoldCounts& counts) const;

 private:
  void flushSums();

  const PackedMap& map_;
  const RegionShape& shape_;
  float sample_scale_, sample_offset_, clamp_low_, clamp_high_;
  bool has_samples_ = false, wide_ = false;
  LeafSums sums_;
  WideSums wide_sums_;
};

}  // namespace accessvdb::internal
