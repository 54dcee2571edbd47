// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// New things block: what lets a thing that appears where the map says "free" block within a few scans, although the
/// mean distances there follow slowly (docs/design/change.md, "New things").
///
/// A voxel has 0 .. 7 votes beside its mean distance. A *return is news* if the map, as it was before the scan, says
/// that its own voxel is free and far from every surface. A scan votes for a voxel if a sample of such a return
/// collides there and the scan as a whole contradicts the map; it denies the voxel if it does not contradict it. Three
/// scans block a voxel, five denials release it. Mean and weight are folded without reading votes, so votes only ever
/// take accessibility away.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "accessvdb/leaf_change.h"
#include "hostdev/vote_rule.h"
#include "tsdf/packed_voxel.h"

namespace accessvdb::internal {

/// Votes of the 512 voxels of a leaf, a number of three bits each:
///   0  none      1, 2  so many scans voted for it      3 .. 7  blocked; each denial takes one, up to the last
struct alignas(64) VoxelVotes {
  std::array<LeafBits, 3> bit = {};  ///< the lowest bits first

  [[nodiscard]] std::uint64_t blocked(std::size_t word) const {
    return kernels::blockedBy(bit[0][word], bit[1][word], bit[2][word]);
  }
  [[nodiscard]] bool blockedAt(std::size_t voxel) const { return (blocked(voxel >> 6) >> (voxel & 63) & 1) != 0; }
  [[nodiscard]] bool any() const {
    std::uint64_t all = 0;
    for (const LeafBits& bits : bit) {
      for (const std::uint64_t word : bits) all |= word;
    }
    return all != 0;
  }
  bool operator==(const VoxelVotes&) const = default;
};

using kernels::castVotes, kernels::NewsRule;
using ScanVerdict = kernels::VerdictOf<LeafBits>;

}  // namespace accessvdb::internal
