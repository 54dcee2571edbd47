// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Votes for things that are new: which returns are news, and what a scan does to the votes of a voxel
/// (docs/design/change.md, "New things").
#pragma once

#include <cstddef>
#include <cstdint>

#include "hostdev/packed_mean.h"

namespace accessvdb::kernels {

/// Which returns are news, by what the map holds in their own voxel.
struct NewsRule {
  std::uint32_t collision_mean = 0;  ///< a voxel with weight collides if its mean is below
  std::uint32_t far_mean = 0;        ///< least mean at which a voxel is far from every surface
  /// A voxel that collides and has at most this weight is itself new. Without this, a thing whose front lies beyond tau
  /// of the old surface would collide at its front at once, and the voxels behind, which are within tau, never.
  static constexpr std::uint32_t kYoungWeight = 8;

  [[nodiscard]] ACCESSVDB_HOSTDEV bool isNews(std::uint32_t packed) const {
    const std::uint32_t weight = weightOf(packed), mean = meanOf(packed);
    return weight > 0 && (mean >= far_mean || (mean < collision_mean && weight <= kYoungWeight));
  }
};

/// What one scan found out about the voxels of a leaf, one bit each. @tparam Bits  those of a leaf, in words
template <typename Bits>
struct VerdictOf {
  Bits contra = {};       ///< a sample of a return that is news collides
  Bits free = {};         ///< observed before the scan, and not colliding
  Bits sampled = {};      ///< the scan has samples
  Bits contradicts = {};  ///< and their mean is less than half of the map's
};

/// Voxels that votes block. @param low, middle, high  the bits of their numbers
template <typename Word>
ACCESSVDB_HOSTDEV constexpr Word blockedBy(Word low, Word middle, Word high) {
  return high | (low & middle);
}

/// One word of a leaf's votes after a scan: 0 -> 1 -> 2 -> 7, 3 .. 7 -> 7 for a vote; 1, 2, 3 -> 0, 4 .. 7 one less for
/// a denial. A scan that samples no voxel, or only shadows of known things, changes nothing.
/// @param votes  bit[0 .. 2][word], the lowest bits first
template <typename Votes, typename Verdict>
ACCESSVDB_HOSTDEV inline void castVotesOf(Votes& votes, std::size_t word, const Verdict& scan) {
  const auto vote = scan.contra[word] & scan.contradicts[word] & scan.free[word];
  const auto denial = scan.sampled[word] & ~scan.contradicts[word];
  const auto a = votes.bit[0][word], b = votes.bit[1][word], c = votes.bit[2][word];
  const auto none = ~(a | b | c), one = a & ~b & ~c;
  const auto neither = ~(vote | denial), lowered = denial & c;
  votes.bit[0][word] = (a & neither) | (vote & ~one) | (lowered & ~a);
  votes.bit[1][word] = (b & neither) | (vote & ~none) | (lowered & ~(a ^ b));
  votes.bit[2][word] = (c & neither) | (vote & ~(none | one)) | (lowered & (a | b));
}

/// @param before, after  receive the blocked voxels
template <typename Votes, typename Verdict, typename Bits>
ACCESSVDB_HOSTDEV inline void castVotes(Votes& votes, const Verdict& scan, Bits& before, Bits& after) {
  for (std::size_t word = 0; word < sizeof(Bits) / sizeof(before[0]); ++word) {
    before[word] = blockedBy(votes.bit[0][word], votes.bit[1][word], votes.bit[2][word]);
    castVotesOf(votes, word, scan);
    after[word] = blockedBy(votes.bit[0][word], votes.bit[1][word], votes.bit[2][word]);
  }
}

}  // namespace accessvdb::kernels
