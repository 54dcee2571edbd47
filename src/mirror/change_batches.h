// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The changes of one call, in batches handed to threads.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

namespace accessvdb::internal {

/// Changes of leaves of one kind (occupancy_leaves.h, distance_leaves.h).
template <class Leaves>
using ChangeLists = std::span<const std::span<const typename Leaves::Change>>;

template <class Leaves>
struct ChangeBatch {
  using Change = typename Leaves::Change;
  static constexpr std::uint32_t kMost = Leaves::kBatch;
  const Change* changes = nullptr;
  std::uint32_t count = 0;
  std::uint32_t begin = 0;  ///< earlier changes of the call
  // Filled while the leaves are located.
  std::uint32_t added = 0, first_added = 0;  ///< leaves that this batch adds; those that earlier batches add
  bool lacks_lower = false;                  ///< a node above one of them is missing too
  bool skips = false;                        ///< has changes without a leaf and without bits
  bool aligned = true;                       ///< its origins are multiples of 8
  bool once = true;                          ///< none of its leaves occurred earlier in this call
};

/// @return number of changes
template <class Leaves>
std::uint32_t divide(ChangeLists<Leaves> lists, std::vector<ChangeBatch<Leaves>>& batches) {
  using ChangeBatch = ChangeBatch<Leaves>;
  batches.clear();
  std::uint32_t total = 0;
  for (const auto& list : lists) {
    for (std::size_t at = 0; at < list.size(); at += ChangeBatch::kMost) {
      const auto count = static_cast<std::uint32_t>(std::min<std::size_t>(list.size() - at, ChangeBatch::kMost));
      batches.push_back({list.data() + at, count, total});
      total += count;
    }
  }
  return total;
}

/// Calls act(n) for n in [begin, end); on several threads if there is enough work.
/// @param least  below this number, runs on one thread
template <class Act>
void forEachIndex(std::size_t begin, std::size_t end, std::size_t least, const Act& act) {
  if (end - begin < least) {
    for (std::size_t n = begin; n < end; ++n) act(n);
  } else {
    tbb::parallel_for(begin, end, act);
  }
}

/// Merges all changes of a leaf into one, in their order. For calls where leaves occur more than once, which a single
/// scan never produces: not fast.
template <class Leaves>
std::vector<typename Leaves::Change> mergedByLeaf(ChangeLists<Leaves> lists) {
  using Change = typename Leaves::Change;
  std::vector<Change> merged;
  for (const auto& list : lists) merged.insert(merged.end(), list.begin(), list.end());
  std::stable_sort(merged.begin(), merged.end(),
                   [](const Change& a, const Change& b) { return a.origin_ijk < b.origin_ijk; });
  std::size_t kept = 0;
  for (std::size_t n = 1; n < merged.size(); ++n) {
    if (merged[n].origin_ijk == merged[kept].origin_ijk) {
      Leaves::append(merged[kept], merged[n]);
    } else {
      merged[++kept] = merged[n];
    }
  }
  merged.resize(merged.empty() ? 0 : kept + 1);
  return merged;
}

}  // namespace accessvdb::internal
