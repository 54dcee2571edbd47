// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Fuses a scan into the leaves that it reaches, on the device: bit for bit what LeafFusion does on the host.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "hostdev/leaf_sums.h"
#include "hostdev/return_ray.h"

namespace accessvdb::kernels {

/// A leaf that a scan may reach.
struct alignas(16) FusedLeaf {
  static constexpr std::uint32_t kNone = 0xffffffffu;
  static constexpr std::uint32_t kFresh = 0x80000000u;  ///< added to a slot in which nothing is yet
  std::int32_t origin_ijk[3];                           ///< lowest voxel
  std::uint32_t begin, end;                             ///< of its returns, in FusionView::entries
  std::uint32_t facts;          ///< the leaf in the grid, in units of LeafPatch::kUnit, or kNone: it is new
  std::uint32_t values, votes;  ///< slots, or kNone: for leaves that only bands reach, and without any news
};

/// What the scan did to a leaf.
struct FusedOutcome {
  static constexpr std::uint32_t kReached = 1;   ///< else nothing else is written, and a new leaf is not wanted
  static constexpr std::uint32_t kSampled = 2;   ///< it has values from now on
  static constexpr std::uint32_t kFlipped = 4;   ///< FusionView::flips says what
  static constexpr std::uint32_t kHasVotes = 8;  ///< it has votes from now on
  std::uint32_t flags;
  std::uint32_t distance_updates, cleared_updates, newly_observed, flipped_voxels;  ///< as in FoldCounts
  std::uint32_t flipped_collisions;  ///< voxels that began or ceased to collide
};

/// Voxels whose facts flipped; 512 bits each, as LeafBits.
struct alignas(16) FusedFlips {
  std::uint32_t collides_on[16], collides_off[16], arm_free_on[16], arm_free_off[16];
};

/// A scan, and the parts of the map that it reaches. All pointers are device memory.
struct FusionView {
  const ReturnRay* rays;
  const LeafEntry* entries;    ///< the returns of each leaf
  const FusedLeaf* leaves;     ///< [count]
  const std::uint32_t* order;  ///< [count] in which they are fused: first those with more than kMostLightEntries
  std::uint32_t count, heavy;
  bool full_cube;  ///< the paper's region in place of the double cone
  bool thin_band;  ///< RegionConstants::thinBand()
  KernelConstants constants;
  const std::byte* grid;   ///< of facts; it is read only
  std::uint32_t* values;   ///< [slots x 512] packed (packed_mean.h)
  std::uint32_t* cleared;  ///< [slots x 16] of leaves with values; of others it is what is free for the arm
  std::uint32_t* votes;    ///< [slots x 3 x 16] the lowest bits first
  FusedOutcome* outcomes;  ///< [count] out
  FusedFlips* flips;       ///< [count] out
};

/// One warp sums the returns of a leaf; eight do if it has more than these, since one would take too long.
inline constexpr std::uint32_t kMostLightEntries = 64;

/// Queues the fusion.
void launchFuseLeaves(const FusionView& view, cudaStream_t stream);

}  // namespace accessvdb::kernels
