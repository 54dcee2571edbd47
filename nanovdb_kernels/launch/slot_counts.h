// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Slots that are taken and given back: how many there are, and how many have to be freed for more.
#pragma once

#include <algorithm>
#include <cstdint>

namespace accessvdb::kernels {

struct SlotCounts {
  std::uint32_t free = 0;  ///< given back
  std::uint32_t next = 0;  ///< the first that was never used

  /// So many there will be once `needs` are taken: free ones first.
  [[nodiscard]] std::uint32_t countWith(std::uint32_t needs) const { return next + (needs > free ? needs - free : 0); }
  /// @return how many to free before `needs` are taken, so that there are no more than `limit`, or no more than now
  [[nodiscard]] std::uint64_t toFree(std::uint32_t needs, std::uint64_t limit) const {
    const std::uint64_t count = countWith(needs);
    return count > limit ? std::min(count - limit, count - next) : 0;
  }
  void take(std::uint32_t needs) {
    next = countWith(needs);
    free -= std::min(needs, free);
  }
};

}  // namespace accessvdb::kernels
