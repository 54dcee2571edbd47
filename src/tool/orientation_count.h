// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Counts the orientations that are done, on any threads, for TableProgress.
#pragma once

#include <atomic>
#include <cstddef>
#include <mutex>

#include "accessvdb/table_progress.h"

namespace accessvdb::internal {

class OrientationCount {
 public:
  /// @param progress  must outlive this; may be empty
  OrientationCount(const TableProgress& progress, std::size_t total) : progress_(progress), total_(total) {}

  void addOne() {
    const std::size_t done = done_.fetch_add(1, std::memory_order_relaxed) + 1;
    if (!progress_) return;
    std::unique_lock<std::mutex> lock(mutex_, std::defer_lock);
    if (done == total_) {
      lock.lock();  // the end must be told
    } else if (!lock.try_lock()) {
      return;  // another thread is telling, and nobody waits for it
    }
    const std::size_t now = done_.load(std::memory_order_relaxed);
    if (now <= told_) return;
    told_ = now;
    progress_(now, total_);
  }

 private:
  const TableProgress& progress_;
  std::size_t total_;
  std::atomic<std::size_t> done_{0};
  std::mutex mutex_;
  std::size_t told_ = 0;  ///< under the mutex
};

}  // namespace accessvdb::internal
