// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Work on the disk beside the steps of a rolling field: one piece after the other, on a thread of its own.
///
/// It is only a head start: whoever needs a piece waits for it, or does it if it has not begun, so that no result
/// depends on when the thread comes to it, or on whether there is one.
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>

namespace accessvdb::tiles {

class DiskThread {
 public:
  /// Tests show that results are the same with the fastest and with the slowest disk.
  enum class Pace {
    Beside,
    AtOnce,     ///< begin() waits for the end
    WhenNeeded  ///< no thread: finish() does it
  };
  /// Of all threads that are made from now on.
  static void setPaceForTests(Pace pace);

  class Work;
  using Handle = std::shared_ptr<Work>;

  DiskThread();
  /// Forgets what has not begun, and waits for what has.
  ~DiskThread();
  DiskThread(const DiskThread&) = delete;
  DiskThread& operator=(const DiskThread&) = delete;

  // All that follows is for one thread.
  /// @param work  what it throws makes it fail
  [[nodiscard]] Handle begin(std::function<void()> work);
  /// Waits for its end; what has not begun is done now. What the work refers to is free then.
  /// @return whether it was done
  bool finish(const Handle& work);
  /// The same, but what has not begun never does.
  bool cancel(const Handle& work);
  [[nodiscard]] bool hasEnded(const Handle& work);

 private:
  void serve();
  static void run(Work& work) noexcept;
  /// @return whether it is the caller's now
  bool takeBack(const Handle& work);

  Pace pace_;
  std::mutex mutex_;  ///< of what follows
  std::condition_variable changed_;
  std::deque<Handle> waiting_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace accessvdb::tiles
