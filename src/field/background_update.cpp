// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "field/background_update.h"

#include <condition_variable>
#include <mutex>
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

UpdateTicket BackgroundUpdate::start(Work work) {
  const auto state = std::make_shared<UpdateState>();
  const std::function<void()> run_all = [work = std::move(work), state] { run(work, *state); };
  const bool beside = thread_.begin(run_all);
  // The ticket comes second: one of work that never begins would wait for ever.
  running_ = state;
  UpdateTicket ticket(state);
  if (!beside) run_all();
  return ticket;
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
