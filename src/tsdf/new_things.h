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
#include "tsdf/packed_voxel.h"

namespace accessvdb::internal {

/// Votes of the 512 voxels of a leaf, a number of three bits each:
///   0  none      1, 2  so many scans voted for it      3 .. 7  blocked; each denial takes one, up to the last
struct alignas(64) VoxelVotes {
  std::array<LeafBits, 3> bit = {};  ///< the lowest bits first

  [[nodiscard]] std::uint64_t blocked(std::size_t word) const { return bit[2][word] | (bit[0][word] & bit[1][word]); }
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

/// What one scan found out about the voxels of a leaf, one bit each.
struct ScanVerdict {
  LeafBits contra = {};       ///< a sample of a return that is news collides
  LeafBits free = {};         ///< observed before the scan, and not colliding
  LeafBits sampled = {};      ///< the scan has samples
  LeafBits contradicts = {};  ///< and their mean is less than half of the map's
};

/// One word of a leaf's votes after a scan: 0 -> 1 -> 2 -> 7, 3 .. 7 -> 7 for a vote; 1, 2, 3 -> 0, 4 .. 7 one less for
/// a denial. A scan that samples no voxel, or only shadows of known things, changes nothing.
inline void castVotesOf(VoxelVotes& votes, std::size_t word, const ScanVerdict& scan) {
  const std::uint64_t vote = scan.contra[word] & scan.contradicts[word] & scan.free[word];
  const std::uint64_t denial = scan.sampled[word] & ~scan.contradicts[word];
  const std::uint64_t a = votes.bit[0][word], b = votes.bit[1][word], c = votes.bit[2][word];
  const std::uint64_t none = ~(a | b | c), one = a & ~b & ~c;
  const std::uint64_t neither = ~(vote | denial), lowered = denial & c;
  votes.bit[0][word] = (a & neither) | (vote & ~one) | (lowered & ~a);
  votes.bit[1][word] = (b & neither) | (vote & ~none) | (lowered & ~(a ^ b));
  votes.bit[2][word] = (c & neither) | (vote & ~(none | one)) | (lowered & (a | b));
}

/// @param before, after  receive the blocked voxels
inline void castVotes(VoxelVotes& votes, const ScanVerdict& scan, LeafBits& before, LeafBits& after) {
  for (std::size_t word = 0; word < before.size(); ++word) {
    before[word] = votes.blocked(word);
    castVotesOf(votes, word, scan);
    after[word] = votes.blocked(word);
  }
}

/// Which returns are news, by what the map holds in their own voxel.
struct NewsRule {
  std::uint32_t collision_mean = 0;  ///< PackedMap::collisionMean()
  std::uint32_t far_mean = 0;        ///< least mean at which a voxel is far from every surface
  /// A voxel that collides and has at most this weight is itself new. Without this, a thing whose front lies beyond tau
  /// of the old surface would collide at its front at once, and the voxels behind, which are within tau, never.
  static constexpr std::uint32_t kYoungWeight = 8;

  [[nodiscard]] bool isNews(std::uint32_t packed) const {
    const std::uint32_t weight = weightOf(packed), mean = meanOf(packed);
    return weight > 0 && (mean >= far_mean || (mean < collision_mean && weight <= kYoungWeight));
  }
};

}  // namespace accessvdb::internal
