// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The changes of one call in blocks, as threads take them.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "accessvdb/leaf_change.h"

namespace accessvdb::internal {

using ChangeParts = std::span<const std::span<const LeafChange>>;

struct ChangeBlock {
  static constexpr std::uint32_t kMost = 256;
  const LeafChange* changes = nullptr;
  std::uint32_t count = 0;
  std::uint32_t begin = 0;  ///< changes of the call that come before
  // Filled while the leaves are located.
  std::uint32_t added = 0, first_added = 0;  ///< leaves that this block adds; those of the blocks before
  bool lacks_lower = false;                  ///< a node above one of those is missing too
  bool skips = false;                        ///< has changes that find no leaf and bring no bits
  bool aligned = true;                       ///< its origins are multiples of 8
  bool once = true;                          ///< none of its leaves came before in this call
};

/// @return number of changes
inline std::uint32_t divide(ChangeParts parts, std::vector<ChangeBlock>& blocks) {
  blocks.clear();
  std::uint32_t total = 0;
  for (const auto& part : parts) {
    for (std::size_t at = 0; at < part.size(); at += ChangeBlock::kMost) {
      const auto count = static_cast<std::uint32_t>(std::min<std::size_t>(part.size() - at, ChangeBlock::kMost));
      blocks.push_back({part.data() + at, count, total});
      total += count;
    }
  }
  return total;
}

/// Calls act(n) for n in [begin, end); on several threads where there is work for them.
/// @param least  do fewer alone
template <class Act>
void forEachIndex(std::size_t begin, std::size_t end, std::size_t least, const Act& act) {
  if (end - begin < least) {
    for (std::size_t n = begin; n < end; ++n) act(n);
  } else {
    tbb::parallel_for(begin, end, act);
  }
}

/// All changes of a leaf as one, in the order in which they come: (b | on) & ~off after (b | on') & ~off' is such a
/// change again. For calls where leaves come more than once, which a single scan never makes: not fast.
inline std::vector<LeafChange> mergedByLeaf(ChangeParts parts) {
  std::vector<LeafChange> merged;
  for (const auto& part : parts) merged.insert(merged.end(), part.begin(), part.end());
  std::stable_sort(merged.begin(), merged.end(),
                   [](const LeafChange& a, const LeafChange& b) { return a.origin_ijk < b.origin_ijk; });
  const auto append = [](LeafBits& on, LeafBits& off, const LeafBits& next_on, const LeafBits& next_off) {
    for (std::size_t n = 0; n < on.size(); ++n) {
      on[n] |= next_on[n];
      off[n] = next_off[n] | (off[n] & ~next_on[n]);
    }
  };
  std::size_t kept = 0;
  for (std::size_t n = 1; n < merged.size(); ++n) {
    LeafChange& last = merged[kept];
    const LeafChange& next = merged[n];
    if (next.origin_ijk == last.origin_ijk) {
      append(last.collides_on, last.collides_off, next.collides_on, next.collides_off);
      append(last.arm_free_on, last.arm_free_off, next.arm_free_on, next.arm_free_off);
    } else {
      merged[++kept] = next;
    }
  }
  merged.resize(merged.empty() ? 0 : kept + 1);
  return merged;
}

}  // namespace accessvdb::internal
