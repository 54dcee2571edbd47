// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory for the leaves of the next scan, prepared in the background.
///
/// While a map grows, a third of a scan's time can go into fresh pages, which the system clears when they are first
/// written. A flight needs about as many from scan to scan; so after each scan a background task writes to as many
/// chunks of the leaf pool (leaf_pool.cpp) as the last ones took. It only changes when pages are cleared.
#pragma once

#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <cstddef>
#include <cstdint>

namespace accessvdb::internal {

class LeafReserve {
 public:
  LeafReserve();
  /// The last one returns unused chunks.
  ~LeafReserve() noexcept;
  LeafReserve(const LeafReserve&) = delete;
  LeafReserve& operator=(const LeafReserve&) = delete;

  /// Call before a scan: what other maps have taken, or this one when it was read from a file, is not its scan's.
  void begin();
  /// Call after a scan, to keep twice the buffers that it took of those that leaves give back. Also prepares the lesser
  /// number of chunks taken by the last two scans, but at most 128 MiB. Returns at once.
  void refill();
  /// Waits for refill().
  void wait();

  /// Chunks of 2 MiB that are ready, of all reserves together.
  [[nodiscard]] static std::size_t readyChunks();

 private:
  std::uint64_t seen_chunks_, seen_reused_ = 0;  ///< since begin()
  std::uint64_t last_taken_ = 0;
  tbb::task_arena arena_;
  tbb::task_group group_;
};

}  // namespace accessvdb::internal
