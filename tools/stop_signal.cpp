// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "stop_signal.h"

#include <csignal>

namespace accessvdb::tools {
namespace {

volatile std::sig_atomic_t stop_signal = 0;

void remember(int signal) {
  stop_signal = signal;
  // Both at once: whoever sends SIGINT and then SIGTERM means it.
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

}  // namespace

void watchStopSignals() {
  std::signal(SIGINT, remember);
  std::signal(SIGTERM, remember);
}

int stopSignal() { return stop_signal; }

}  // namespace accessvdb::tools
