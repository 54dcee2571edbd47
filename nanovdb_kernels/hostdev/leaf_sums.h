// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What the returns of a scan do to one leaf: the terms of leaf_kernels_body.h that do not depend on its lanes.
#pragma once

#include <cstdint>

#include "hostdev/packed_mean.h"

namespace accessvdb::kernels {

/// Sums of one scan over the 512 voxels of a leaf. Stays in the fastest memory; zero except where there are samples.
///
/// A voxel's sum of samples, in steps of kSampleSteps, and their count share a word: most leaves get one or two
/// returns.
struct LeafSums {
  static constexpr unsigned kDistanceBits = 24;  ///< the lower ones
  static constexpr std::uint32_t kMostSamples = (1u << (32 - kDistanceBits)) - 1;
  alignas(64) std::uint32_t packed[512] = {};

  ACCESSVDB_HOSTDEV static constexpr std::uint32_t pack(std::uint32_t distance, std::uint32_t samples) {
    return samples << kDistanceBits | distance;
  }
  ACCESSVDB_HOSTDEV static constexpr std::uint32_t distanceOf(std::uint32_t packed) {
    return packed & ((1u << kDistanceBits) - 1);
  }
  ACCESSVDB_HOSTDEV static constexpr std::uint32_t samplesOf(std::uint32_t packed) { return packed >> kDistanceBits; }
};
static_assert(std::uint64_t{LeafSums::kMostSamples} * kSampleSteps >> LeafSums::kDistanceBits == 0,
              "the largest sum does not reach the bits of the count");

/// Constants of a map, in voxels.
struct KernelConstants {
  float tau;
  float cone_cos, cone_cos_squared;
  float clamp_low, clamp_high, sample_scale;  ///< steps of kSampleSteps per voxel
  float band_begin, band_end, band_radius_squared;
  float line_end;             ///< of what rays clear beyond the band; 0: nothing
  float ball_radius_squared;  ///< of what the platform clears
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

/// A leaf of the map while a scan is folded into it. @tparam Bits  those of a leaf, in words
template <typename Bits, typename Word, typename Votes>
struct LeafTargetOf {
  std::uint32_t* packed;         ///< [512], or nullptr if there are neither samples nor older ones
  Word* cleared;                 ///< [words]
  Votes* votes = nullptr;        ///< nullptr: there are none, and nothing votes
  const Bits* contra = nullptr;  ///< only with votes: VerdictOf::contra
};

/// What a scan says about a leaf whose free space ages.
template <typename Bits>
struct AgedFactsOf {
  const Bits& was_free;   ///< confirmed before the scan, in this generation or the one before
  const Bits& confirmed;  ///< by the scan
  const Bits& collided;   ///< before the scan, where that can matter
};

// A leaf that more returns reach than LeafSums can hold has wider sums, and is folded voxel by voxel.

/// @param old  packed  @param distance, samples  sums of the voxel  @return the voxel, packed
ACCESSVDB_HOSTDEV inline std::uint32_t foldedWide(std::uint32_t old, std::uint64_t distance, std::uint64_t samples,
                                                  std::uint64_t max_weight) {
  const std::uint64_t total = weightOf(old) + samples;
  const double numerator = static_cast<double>(meanOf(old)) * weightOf(old) + 16.0 * static_cast<double>(distance);
  const auto mean = static_cast<std::uint32_t>(numerator / static_cast<double>(total) + 0.5);
  return packVoxel(mean, static_cast<std::uint32_t>(total < max_weight ? total : max_weight));
}

/// Whether samples contradict the map: their mean is less than half of its own, both from the mean whose distance is 0.
ACCESSVDB_HOSTDEV inline bool contradictsWide(std::uint32_t old, std::uint64_t distance, std::uint64_t samples,
                                              std::int32_t zero_mean) {
  return 32 * distance < (meanOf(old) + static_cast<std::uint64_t>(zero_mean)) * samples;
}

}  // namespace accessvdb::kernels
