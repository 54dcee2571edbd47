// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/work_thread.h"

#include <exception>
#include <utility>

namespace accessvdb::internal {

WorkThread::~WorkThread() {
  if (!thread_.joinable()) return;
  {
    const std::scoped_lock lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

bool WorkThread::begin(const std::function<void()>& work) {
  try {
    if (!thread_.joinable()) thread_ = std::thread([this] { serve(); });
  } catch (const std::exception&) {  // no more threads, or no memory for one
    return false;
  }
  {
    const std::scoped_lock lock(mutex_);
    waiting_.push_back(work);
  }
  wake_.notify_one();
  return true;
}

void WorkThread::serve() {
  for (;;) {
    std::function<void()> work;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return stop_ || !waiting_.empty(); });
      if (waiting_.empty()) return;
      work = std::move(waiting_.front());
      waiting_.pop_front();
    }
    work();
  }
}

}  // namespace accessvdb::internal
