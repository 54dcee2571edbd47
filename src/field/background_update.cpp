// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/background_update.h"

#include <system_error>
#include <utility>

#include "accessvdb/error.h"

namespace accessvdb {

/// What a ticket and its field share.
struct internal::UpdateState {
  std::mutex mutex;
  std::condition_variable changed;
  bool map_released = false, done = false;
  UpdateStats stats;
  std::exception_ptr error;

  void waitUntilDone() {
    std::unique_lock lock(mutex);
    changed.wait(lock, [this] { return done; });
  }
};

UpdateTicket::UpdateTicket() noexcept = default;
UpdateTicket::UpdateTicket(std::shared_ptr<internal::UpdateState> state) noexcept : state_(std::move(state)) {}
UpdateTicket::~UpdateTicket() { settle(); }
UpdateTicket::UpdateTicket(UpdateTicket&&) noexcept = default;
UpdateTicket& UpdateTicket::operator=(UpdateTicket&& other) noexcept {
  if (this == &other) return *this;
  settle();
  state_ = std::move(other.state_);
  return *this;
}

void UpdateTicket::settle() const noexcept {
  if (state_) state_->waitUntilDone();
}

UpdateStats UpdateTicket::wait() const {
  if (!state_) {
    throw InvalidArgument("update.no_ticket", "", "this ticket stands for no update",
                          "Keep the ticket that updateAsync() returned");
  }
  state_->waitUntilDone();
  if (state_->error) std::rethrow_exception(state_->error);
  return state_->stats;
}

bool UpdateTicket::done() const {
  if (!state_) return true;
  const std::scoped_lock lock(state_->mutex);
  return state_->done;
}

namespace internal {

BackgroundUpdate::~BackgroundUpdate() {
  static_cast<void>(take());
  if (!thread_.joinable()) return;
  {
    const std::scoped_lock lock(mutex_);
    stop_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

UpdateTicket BackgroundUpdate::start(Work work) {
  // The thread comes first: a ticket of work that never begins would wait for ever.
  try {
    if (!thread_.joinable()) thread_ = std::thread([this] { serve(); });
  } catch (const std::exception&) {  // no more threads, or no memory for one
  }
  running_ = std::make_shared<UpdateState>();
  UpdateTicket ticket(running_);
  if (!thread_.joinable()) {
    run(work, *running_);
    return ticket;
  }
  {
    const std::scoped_lock lock(mutex_);
    work_ = std::move(work);
    next_ = running_;
  }
  wake_.notify_one();
  return ticket;
}

void BackgroundUpdate::serve() {
  for (;;) {
    Work work;
    std::shared_ptr<UpdateState> state;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return stop_ || next_ != nullptr; });
      if (next_ == nullptr) return;
      work = std::exchange(work_, nullptr);
      state = std::move(next_);
    }
    run(work, *state);
  }
}

void BackgroundUpdate::run(const Work& work, UpdateState& state) {
  UpdateStats stats;
  std::exception_ptr error;
  try {
    stats = work([&state] {
      {
        const std::scoped_lock lock(state.mutex);
        state.map_released = true;
      }
      state.changed.notify_all();
    });
  } catch (...) {
    error = std::current_exception();
  }
  {
    const std::scoped_lock lock(state.mutex);
    state.stats = stats;
    state.error = error;
    state.map_released = state.done = true;
  }
  state.changed.notify_all();
}

void BackgroundUpdate::waitForMap() const {
  if (!running_) return;
  std::unique_lock lock(running_->mutex);
  running_->changed.wait(lock, [this] { return running_->map_released; });
}

std::exception_ptr BackgroundUpdate::take() {
  const std::shared_ptr<UpdateState> taken = std::exchange(running_, nullptr);
  if (!taken) return nullptr;
  taken->waitUntilDone();
  return taken->error;
}

}  // namespace internal
}  // namespace accessvdb
