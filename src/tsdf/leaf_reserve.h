// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Memory for the leaves of the next scan, made ready while nobody waits for it.
///
/// Where a map grows, a third of the time of a scan can go into fresh pages, which the system clears when they are
/// first written. A flight takes about as many from scan to scan; so after each scan a task beside the others writes to
/// as many chunks of the leaf pool (leaf_pool.cpp) as the last ones took. It changes when pages are cleared, and
/// nothing else.
#pragma once

#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <cstddef>
#include <cstdint>

namespace accessvdb::internal {

class LeafReserve {
 public:
  LeafReserve();
  /// The last one gives back what nobody took.
  ~LeafReserve() noexcept;
  LeafReserve(const LeafReserve&) = delete;
  LeafReserve& operator=(const LeafReserve&) = delete;

  /// After a scan: makes ready what each of the last two scans took at least, but no more than 128 MiB. Returns at
  /// once.
  void refill();
  /// Waits for refill().
  void wait();

  /// Chunks of 2 MiB that are ready, of all reserves together.
  [[nodiscard]] static std::size_t readyChunks();

 private:
  std::uint64_t seen_chunks_, last_taken_ = 0;
  tbb::task_arena arena_;
  tbb::task_group group_;
};

}  // namespace accessvdb::internal
