// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Where the ids of each block lie in one array on the device: one run of slots per block, doubled whenever it is full.
/// The host decides; released runs are reused. It also tells which group a block belongs to.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "launch/point_delta.h"
#include "points/surface_index.h"
#include "update/block_groups.h"

namespace accessvdb::internal {

class DeviceBlocks {
 public:
  /// @param group_log2  [log2 of leaves] edge of a group of blocks
  explicit DeviceBlocks(int group_log2) : groups_(group_log2) {}

  /// Describes blocks whose points have changed. @param changed  each once
  /// @param blocks  all of them  @param deltas, ids  out, in that order
  void deltas(std::span<const std::uint32_t> changed, const ChunkedArray<PointBlock>& blocks,
              std::vector<kernels::BlockDelta>& deltas, std::vector<std::uint32_t>& ids) {
    deltas.resize(changed.size());
    const tbb::blocked_range<std::size_t> all(0, changed.size(), kBlocksPerTask);
    tbb::parallel_for(all, [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        const PointBlock& block = blocks[changed[n]];
        deltas[n] = {};
        deltas[n].block = changed[n];
        deltas[n].count = static_cast<std::uint32_t>(block.ids.size());
        for (std::size_t axis = 0; axis < 3; ++axis) deltas[n].leaf[axis] = block.leaf[axis];
      }
    });
    runs_.grow(blocks.size());
    std::uint32_t source = 0;
    for (kernels::BlockDelta& block : deltas) {
      block.source = source;
      source += block.count;
      Run& run = runs_[block.block];
      block.is_new = run.capacity == 0 ? 1 : 0;
      if (block.is_new != 0) block.group = groups_.add(block.block, {block.leaf[0], block.leaf[1], block.leaf[2]});
      if (block.count > run.capacity) {
        if (run.capacity > 0) free_[classOf(run.capacity)].push_back(run.first);
        run = take(std::bit_ceil(std::max(block.count, kLeastSlots)));
      }
      block.first = run.first;
    }
    ids.resize(source);
    tbb::parallel_for(all, [&](const auto& range) {
      for (std::size_t n = range.begin(); n != range.end(); ++n) {
        std::ranges::copy(blocks[changed[n]].ids, ids.begin() + static_cast<std::ptrdiff_t>(deltas[n].source));
      }
    });
  }
  /// Total number of slots, used and free.
  [[nodiscard]] std::uint32_t slots() const { return slots_; }
  /// Number of groups of all blocks so far.
  [[nodiscard]] std::uint32_t groups() const { return groups_.size(); }
  [[nodiscard]] std::uint64_t bytes() const {
    std::uint64_t bytes = runs_.bytes() + groups_.bytes();
    for (const std::vector<std::uint32_t>& free : free_) bytes += free.capacity() * sizeof(std::uint32_t);
    return bytes;
  }

 private:
  struct Run {
    std::uint32_t first = 0, capacity = 0;
  };
  static constexpr std::size_t kBlocksPerTask = 256;
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

  BlockGroups groups_;
  ChunkedArray<Run> runs_;
  std::vector<std::uint32_t> free_[10];
  std::uint32_t slots_ = 0;
};

}  // namespace accessvdb::internal
