// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "stop_signal.h"

#include <atomic>
#include <csignal>

namespace accessvdb::tools {
namespace {

std::atomic<int> stop_signal = 0;
static_assert(std::atomic<int>::is_always_lock_free, "the handler must not wait");

/// The first signal requests a stop; a second one, of either kind, ends the program at once. Threads may handle signals
/// at the same time, so the exchange decides which one is first.
void remember(int signal) {
  int none = 0;
  if (stop_signal.compare_exchange_strong(none, signal)) return;
  std::signal(signal, SIG_DFL);
  raise(signal);
}

}  // namespace

void watchStopSignals() {
  std::signal(SIGINT, remember);
  std::signal(SIGTERM, remember);
}

int stopSignal() { return stop_signal; }

}  // namespace accessvdb::tools
