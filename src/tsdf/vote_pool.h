// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Votes of the leaves that have any: few leaves of a map, so beside it.
#pragma once

#include <tbb/concurrent_vector.h>

#include <cstdint>
#include <mutex>
#include <vector>

#include "tsdf/new_things.h"

namespace accessvdb::internal {

/// Numbers begin at 1 and say nothing about a leaf: which one it gets depends on the threads. All members may be called
/// from several threads at once, for different numbers.
class VotePool {
 public:
  /// @return their number, for get() and remove()  @throws std::bad_alloc
  std::uint32_t add(const VoxelVotes& votes) {
    const std::lock_guard lock(mutex_);
    std::uint32_t number;
    if (free_.empty()) {
      if (free_.capacity() <= all_.size()) free_.reserve(2 * all_.size() + 64);  // so that remove() cannot fail
      number = static_cast<std::uint32_t>(all_.push_back(votes) - all_.begin()) + 1;
    } else {
      number = free_.back();
      free_.pop_back();
      all_[number - 1] = votes;
    }
    return number;
  }
  void remove(std::uint32_t number) {
    const std::lock_guard lock(mutex_);
    free_.push_back(number);
  }

  [[nodiscard]] VoxelVotes& get(std::uint32_t number) { return all_[number - 1]; }
  [[nodiscard]] const VoxelVotes& get(std::uint32_t number) const { return all_[number - 1]; }

  /// Leaves that have votes.
  [[nodiscard]] std::uint64_t size() const { return all_.size() - free_.size(); }
  [[nodiscard]] std::uint64_t bytes() const { return size() * (sizeof(VoxelVotes) + sizeof(std::uint32_t)); }

 private:
  tbb::concurrent_vector<VoxelVotes> all_;  ///< never move while others are added
  std::vector<std::uint32_t> free_;
  std::mutex mutex_;
};

}  // namespace accessvdb::internal
