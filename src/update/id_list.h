// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Ids collected over several scans, in any order and with repeats. They are merged from time to time, so that a long
/// period without updates takes bounded memory.
#pragma once

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace accessvdb::internal {

class IdList {
 public:
  void add(std::span<const std::uint32_t> ids) {
    constexpr std::size_t kMostIds = std::size_t{1} << 20;
    ids_.insert(ids_.end(), ids.begin(), ids.end());
    if (ids_.size() > 2 * joined_ + kMostIds) join();
  }
  /// Returns the ids, ascending, each once, and empties the list.
  std::vector<std::uint32_t> take() {
    join();
    joined_ = 0;
    return std::exchange(ids_, {});
  }
  [[nodiscard]] std::uint64_t bytes() const { return ids_.capacity() * sizeof(std::uint32_t); }

 private:
  void join() {
    tbb::parallel_sort(ids_);
    ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
    joined_ = ids_.size();
  }

  std::vector<std::uint32_t> ids_;
  std::size_t joined_ = 0;  ///< this many at the front: ascending, each once
};

}  // namespace accessvdb::internal
