// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/disk_thread.h"

#include <algorithm>
#include <atomic>
#include <system_error>
#include <utility>

namespace accessvdb::tiles {
namespace {

std::atomic<DiskThread::Pace> pace_of_tests = DiskThread::Pace::Beside;

}  // namespace

class DiskThread::Work {
 public:
  explicit Work(std::function<void()> given) : run(std::move(given)) {}
  std::function<void()> run;
  bool ended = false, done = false;  ///< under the thread's mutex
};

void DiskThread::setPaceForTests(Pace pace) { pace_of_tests = pace; }

DiskThread::DiskThread() : pace_(pace_of_tests) {}

DiskThread::~DiskThread() {
  {
    const std::scoped_lock lock(mutex_);
    stop_ = true;
    waiting_.clear();
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

DiskThread::Handle DiskThread::begin(std::function<void()> work) {
  const auto handle = std::make_shared<Work>(std::move(work));
  {
    const std::scoped_lock lock(mutex_);
    waiting_.push_back(handle);
  }
  if (pace_ == Pace::WhenNeeded) return handle;
  if (!thread_.joinable()) {
    try {
      thread_ = std::thread([this] { serve(); });
    } catch (const std::system_error&) {  // without memory for a thread, work waits until it is needed
      return handle;
    }
  }
  changed_.notify_all();
  if (pace_ == Pace::AtOnce) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return handle->ended; });
  }
  return handle;
}

bool DiskThread::finish(const Handle& work) {
  if (takeBack(work)) {
    run(*work);
    work->ended = true;
  }
  return work->done;
}

bool DiskThread::cancel(const Handle& work) {
  if (takeBack(work)) work->ended = true;
  return work->done;
}

bool DiskThread::hasEnded(const Handle& work) {
  const std::scoped_lock lock(mutex_);
  return work->ended;
}

bool DiskThread::takeBack(const Handle& work) {
  std::unique_lock lock(mutex_);
  const auto found = std::find(waiting_.begin(), waiting_.end(), work);
  if (found != waiting_.end()) {
    waiting_.erase(found);
    return true;
  }
  changed_.wait(lock, [&] { return work->ended; });
  return false;
}

void DiskThread::run(Work& work) noexcept {
  try {
    work.run();
    work.done = true;
  } catch (...) {  // who needs it tries again, and sees what is in the way
  }
  work.run = nullptr;
}

void DiskThread::serve() {
  for (;;) {
    Handle work;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stop_ || !waiting_.empty(); });
      if (stop_) return;
      work = std::move(waiting_.front());
      waiting_.pop_front();
    }
    run(*work);
    {
      const std::scoped_lock lock(mutex_);
      work->ended = true;
    }
    changed_.notify_all();
  }
}

}  // namespace accessvdb::tiles
