// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The inner loops of integration (hostdev/leaf_kernels_body.h), compiled for several instruction sets; one set is
/// selected at run time. Results are bit for bit the same for every set.
#pragma once

#include <cstdint>

#include "accessvdb/leaf_change.h"
#include "hostdev/leaf_sums.h"
#include "processor/kernel_list.h"
#include "tsdf/new_things.h"
#include "tsdf/packed_voxel.h"
#include "tsdf/return_region.h"

namespace accessvdb::internal {

/// Voxels of a leaf are handled 16 at a time: two rows along z, one cache line. Pair n holds x = n/4, y = 2(n%4), +1.
inline constexpr int kPairs = 32;

using kernels::FoldCounts, kernels::KernelConstants, kernels::LeafSums, kernels::ReturnInLeaf;
using LeafTarget = kernels::LeafTargetOf<LeafBits, std::uint64_t, VoxelVotes>;
using AgedFacts = kernels::AgedFactsOf<LeafBits>;

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
