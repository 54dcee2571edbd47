// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory for the ids of blocks: runs with power-of-two sizes, cut from chunks. A run that a block has outgrown is
/// reused.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace accessvdb::internal {

class IdRuns {
 public:
  /// Capacity of the run of a block with `count` ids; at most 512.
  static std::size_t capacityFor(std::size_t count) { return count == 0 ? 0 : std::bit_ceil(std::max(count, kLeast)); }

  /// @param capacity  a result of capacityFor() other than 0
  std::uint32_t* take(std::size_t capacity) {
    std::vector<std::uint32_t*>& free = free_[classOf(capacity)];
    if (!free.empty()) {
      std::uint32_t* run = free.back();
      free.pop_back();
      return run;
    }
    if (left_ < capacity) {  // the rest, at most a few hundredths of a chunk, is wasted
      chunks_.push_back(std::make_unique_for_overwrite<std::uint32_t[]>(kChunk));
      left_ = kChunk;
    }
    left_ -= capacity;
    return chunks_.back().get() + left_;
  }
  void giveBack(std::uint32_t* run, std::size_t capacity) { free_[classOf(capacity)].push_back(run); }

  [[nodiscard]] std::uint64_t bytes() const {
    std::uint64_t bytes = chunks_.size() * kChunk * sizeof(std::uint32_t) + chunks_.capacity() * sizeof(chunks_[0]);
    for (const auto& free : free_) bytes += free.capacity() * sizeof(free[0]);
    return bytes;
  }

 private:
  static constexpr std::size_t kLeast = 4, kMost = 512, kChunk = 1 << 14;
  static std::size_t classOf(std::size_t capacity) {
    return static_cast<std::size_t>(std::countr_zero(capacity) - std::countr_zero(kLeast));
  }

  std::vector<std::unique_ptr<std::uint32_t[]>> chunks_;
  std::size_t left_ = 0;  ///< free ids at the front of the last chunk
  std::array<std::vector<std::uint32_t*>, std::countr_zero(kMost / kLeast) + 1> free_;
};

}  // namespace accessvdb::internal
