// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Everything that one scan does to one leaf, summed in integers, then folded into the map once.
///
/// Integer sums do not depend on their order, and each scan is folded once, so the map is bit for bit the same for any
/// number of threads and any order of the points within a scan.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "accessvdb/leaf_change.h"
#include "processor/prefetch.h"
#include "tsdf/leaf_kernels.h"
#include "tsdf/packed_map.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

using kernels::LeafEntry;

/// Totals for a leaf that more returns reach than LeafSums can hold.
struct WideSums {
  std::array<std::uint64_t, 512> distance = {};
  std::array<std::uint32_t, 512> samples = {};
};

/// What the kernels need to know of a map, with the collision distance that it has now.
[[nodiscard]] KernelConstants kernelConstants(const PackedMap& map, const RegionShape& shape);

class LeafFusion {
 public:
  LeafFusion(const PackedMap& map, const RegionShape& shape, const LeafKernels& kernels = leafKernels());

  /// accumulate() reads this many entries beyond the end of its span, to prefetch their returns.
  static constexpr std::size_t kLookAhead = 6;

  /// Sums all entries of one leaf. @return false if no voxel of the leaf is reached
  bool accumulate(const std::array<std::int32_t, 3>& origin_ijk, std::span<const LeafEntry> entries,
                  const ReturnRay* rays);

  /// Whether accumulate() found distance samples (else only band passes).
  [[nodiscard]] bool hasSamples() const { return touched_ != 0; }
  /// The pairs of rows with samples, one bit each, until fold().
  [[nodiscard]] std::uint32_t touchedPairs() const { return touched_; }

  /// Starts fetching the values that fold() will read. The leaf itself must be in the cache.
  void prefetchValues(const PackedLeaf& leaf) const;

  /// Folds the sums into the leaf, whose values must be plain if hasSamples().
  /// @return true if a voxel's collides or arm_free flipped; then `change` says which
  /// @param votes  of the leaf, or those that it may get; nullptr if it has none and foundNews() is false
  bool fold(PackedLeaf& leaf, VoxelVotes* votes, LeafChange& change, FoldCounts& counts);

  /// Voxels with samples, until fold() or dropSamples().
  [[nodiscard]] LeafBits sampled() const;
  /// Leaves only what passed through: the leaf has no place for values.
  void dropSamples();

  /// Whether accumulate() met a return that is news in a voxel where it collides.
  [[nodiscard]] bool foundNews() const { return found_news_; }

 private:
  [[nodiscard]] std::uint32_t gainedPairs(const PackedLeaf& leaf) const;
  void flushSums();
  void clearSums();
  void markThinBand(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ray);
  void markLine(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ray);
  void markBall(const std::array<std::int32_t, 3>& origin_ijk, const ReturnRay& ball);
  void pass(int voxel);
  bool foldAged(const PackedLeaf& leaf, const LeafTarget& target, LeafChange& change, FoldCounts& counts);
  void markWideFree(LeafBits& free) const;
  [[nodiscard]] ScanVerdict judgeWide(const LeafTarget& leaf, const KernelConstants& constants) const;
  bool foldWide(const LeafTarget& leaf, const KernelConstants& constants, LeafChange& change, FoldCounts& counts);

  const PackedMap& map_;
  const RegionShape& shape_;
  const LeafKernels& kernels_;
  KernelConstants constants_;
  bool wide_ = false;
  std::uint32_t touched_ = 0;  ///< pairs of rows with samples
  std::uint64_t passes_ = 0;
  LeafBits passed_ = {};
  LeafBits contra_ = {};  ///< ScanVerdict::contra
  bool found_news_ = false;
  LeafSums sums_;
  WideSums wide_sums_;
};

}  // namespace accessvdb::internal
