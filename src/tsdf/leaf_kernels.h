// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inner loops of integration, written once and compiled for several instruction sets; one set is selected at run
/// time.
///
/// Results are bit for bit the same for every set: each step is an IEEE operation that rounds once (no contraction), in
/// the same order for every lane width.
#pragma once

#include <array>
#include <cstdint>

#include "accessvdb/leaf_change.h"
#include "processor/kernel_list.h"
#include "tsdf/new_things.h"
#include "tsdf/packed_voxel.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// Voxels of a leaf are handled 16 at a time: two rows along z, one cache line. Pair n holds x = n/4, y = 2(n%4), +1.
inline constexpr int kPairs = 32;

/// Sums of one scan over the 512 voxels of a leaf. Stays in the first-level cache; zero except in touched pairs.
///
/// A voxel's sum of samples, in steps of kSampleSteps, and their count share a word: most leaves get one or two
/// returns.
struct LeafSums {
  static constexpr unsigned kDistanceBits = 24;  ///< the lower ones
  static constexpr std::uint32_t kMostSamples = (1u << (32 - kDistanceBits)) - 1;
  alignas(64) std::array<std::uint32_t, 512> packed = {};

  static constexpr std::uint32_t pack(std::uint32_t distance, std::uint32_t samples) {
    return samples << kDistanceBits | distance;
  }
  static constexpr std::uint32_t distanceOf(std::uint32_t packed) { return packed & ((1u << kDistanceBits) - 1); }
  static constexpr std::uint32_t samplesOf(std::uint32_t packed) { return packed >> kDistanceBits; }
};
static_assert(std::uint64_t{LeafSums::kMostSamples} * kSampleSteps >> LeafSums::kDistanceBits == 0,
              "the largest sum does not reach the bits of the count");

/// One return as seen from one leaf, in voxels.
struct ReturnInLeaf {
  std::array<float, 3> leaf;       ///< lowest voxel of the leaf minus the return's voxel
  std::array<float, 3> offset;     ///< return minus its voxel
  std::array<float, 3> to_sensor;  ///< [u]
  float range;                     ///< [R]
  Interval box_x;                  ///< extent of the region
};

/// Constants of a map, in voxels.
struct KernelConstants {
  float tau;
  float cone_cos, cone_cos_squared;
  float clamp_low, clamp_high, sample_scale;  ///< steps of kSampleSteps per voxel
  float band_begin, band_end, band_radius_squared;
  std::int32_t max_weight;
  std::int32_t collision_mean;
  std::int32_t collision_sample;  ///< a sample below this collides
  std::int32_t zero_mean;         ///< the mean whose distance is 0
};

/// Counts of one or many folds.
struct FoldCounts {
  std::uint64_t distance_updates = 0;
  std::uint64_t cleared_updates = 0;
  std::uint64_t newly_observed = 0;
  std::uint64_t flipped_voxels = 0;  ///< in which a fact flipped
};

/// A leaf of the map while a scan is folded into it.
struct LeafTarget {
  std::uint32_t* packed;             ///< [512], or nullptr if there are neither samples nor older ones
  std::uint64_t* cleared;            ///< [8]
  VoxelVotes* votes = nullptr;       ///< nullptr: there are none, and nothing votes
  const LeafBits* contra = nullptr;  ///< only with votes: ScanVerdict::contra
};

/// What a scan says about a leaf whose free space ages.
struct AgedFacts {
  const LeafBits& was_free;   ///< confirmed before the scan, in this generation or the one before
  const LeafBits& confirmed;  ///< by the scan
  const LeafBits& collided;   ///< before the scan, where that can matter
};

struct LeafKernels {
  const char* name;
  /// Adds the samples of one return to fewer than LeafSums::kMostSamples others.
  /// @return pairs of rows that got any, one bit each
  std::uint32_t (*add_double_cone)(const ReturnInLeaf& ray, const KernelConstants& constants, LeafSums& sums);
  /// The same for a return that is news: also marks the voxels in which its sample collides.
  std::uint32_t (*add_news)(const ReturnInLeaf& ray, const KernelConstants& constants, LeafSums& sums,
                            LeafBits& contra);
  std::uint32_t (*add_full_cube)(const ReturnInLeaf& ray, const KernelConstants& constants, LeafSums& sums);
  /// Marks the voxels of one return's cleared band. @return their number
  std::uint32_t (*mark_band)(const ReturnInLeaf& ray, const KernelConstants& constants, LeafBits& passed);
  /// Pairs of rows with voxels that were passed and not cleared yet, one bit each.
  std::uint32_t (*gained_pairs)(const LeafBits& passed, const LeafBits& cleared);
  /// Where free space ages, before fold(): marks the voxels whose samples, taken together, are free.
  void (*mark_measured_free)(const LeafSums& sums, const KernelConstants& constants, std::uint32_t touched,
                             LeafBits& free);
  /// Marks the voxels that collide by their means. @param pairs  of rows to look at
  void (*mark_colliding)(const std::uint32_t* packed, const KernelConstants& constants, std::uint32_t pairs,
                         LeafBits& collides);
  /// Where free space ages, after fold(): what flipped for the arm, in addition to what collides.
  /// @param confirmed  [8] in this generation; added to  @return number of voxels in which a fact flipped
  std::uint64_t (*flip_arm)(const AgedFacts& facts, std::uint64_t* confirmed, LeafChange& change);
  /// Folds sums and passes into a leaf and resets the sums to zero.
  /// @param touched  pairs with samples  @return true if a fact flipped; then `change` is written
  bool (*fold)(const LeafTarget& leaf, const KernelConstants& constants, std::uint32_t touched, LeafSums& sums,
               const LeafBits& passed, LeafChange& change, FoldCounts& counts);
};

/// Best set for this machine.
const LeafKernels& leafKernels();
/// All sets that run on this machine, best first.
KernelList<LeafKernels> runnableLeafKernels();

}  // namespace accessvdb::internal
