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
  // Each blocks the other while its handler runs, so that a second signal right behind the first finds the default.
  struct sigaction action = {};
  action.sa_handler = remember;
  sigemptyset(&action.sa_mask);
  sigaddset(&action.sa_mask, SIGINT);
  sigaddset(&action.sa_mask, SIGTERM);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

int stopSignal() { return stop_signal; }

}  // namespace accessvdb::tools
