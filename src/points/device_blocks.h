// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the ids of each block lie in one array on the device: a run of slots a block, twice as long whenever it is
/// full. The host decides; the runs that are given up are used again.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "launch/point_updater.h"
#include "points/surface_index.h"

namespace accessvdb::internal {

class DeviceBlocks {
 public:
  /// The block has other points than before. @param ids  its ids are appended here
  kernels::BlockNews news(std::uint32_t block, const PointBlock& points, std::vector<std::uint32_t>& ids) {
    kernels::BlockNews news;
    news.block = block;
    news.is_new = block >= runs_.size() ? 1 : 0;
    if (news.is_new != 0) runs_.resize(block + 1);
    Run& run = runs_[block];
    const auto count = static_cast<std::uint32_t>(points.ids.size());
    if (count > run.capacity) {
      if (run.capacity > 0) free_[classOf(run.capacity)].push_back(run.first);
      run = take(std::bit_ceil(count < kLeastSlots ? kLeastSlots : count));
    }
    for (std::size_t axis = 0; axis < 3; ++axis) news.leaf[axis] = points.leaf[axis];
    news.first = run.first;
    news.count = count;
    news.source = static_cast<std::uint32_t>(ids.size());
    ids.insert(ids.end(), points.ids.begin(), points.ids.end());
    return news;
  }
  /// Slots in use or free, from 0.
  [[nodiscard]] std::uint32_t slots() const { return slots_; }
  [[nodiscard]] std::uint64_t bytes() const { return runs_.capacity() * sizeof(Run); }

 private:
  struct Run {
    std::uint32_t first = 0, capacity = 0;
  };
  static constexpr std::uint32_t kLeastSlots = 8;  ///< a block holds at most 512 points
  static std::size_t classOf(std::uint32_t capacity) { return static_cast<std::size_t>(std::countr_zero(capacity)); }

  Run take(std::uint32_t capacity) {
    auto& free = free_[classOf(capacity)];
    if (!free.empty()) {
      const Run run = {free.back(), capacity};
      free.pop_back();
      return run;
    }
    const Run run = {slots_, capacity};
    slots_ += capacity;
    return run;
  }

  std::vector<Run> runs_;
  std::vector<std::uint32_t> free_[10];
  std::uint32_t slots_ = 0;
};

}  // namespace accessvdb::internal
