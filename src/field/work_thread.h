// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A thread that does pieces of work, one after the other.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <thread>

namespace accessvdb::internal {

class WorkThread {
 public:
  WorkThread() = default;
  /// Waits until all that was begun is done.
  ~WorkThread();
  WorkThread(const WorkThread&) = delete;
  WorkThread& operator=(const WorkThread&) = delete;

  /// Work is done after what was given before; it must not throw. The thread stays for the next: what threads keep for
  /// themselves is made once. For one thread at a time.
  /// @return false, and nothing done or changed, if there is no memory for a thread  @throws std::bad_alloc likewise
  [[nodiscard]] bool begin(const std::function<void()>& work);

 private:
  void serve();

  std::mutex mutex_;  ///< of what follows
  std::condition_variable wake_;
  std::deque<std::function<void()>> waiting_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace accessvdb::internal
