// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/stop_signal.h"

#include <unistd.h>

#include <atomic>
#include <csignal>
#include <ctime>
#include <string_view>

#include "accessvdb/program/output_file.h"

namespace accessvdb::tools {
namespace {

/// Without a look at the flag and with less than this much computed in the time between two looks at it, the program is
/// blocked: reading from a slow disk takes far more.
constexpr unsigned kPatience_s = 5;
constexpr std::int64_t kBusy_ns = 20'000'000;

std::atomic<int> stop_signal = 0;
std::atomic<bool> noticed = false;
std::atomic<std::int64_t> computed_ns = 0;  // until the last look
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<std::int64_t>::is_always_lock_free,
              "the handlers must not wait");

void endBy(int signal) {
  std::signal(signal, SIG_DFL);
  raise(signal);
}

std::int64_t processorTime_ns() {
  timespec time = {};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
}

void lookAgain(int) {
  if (noticed) return;
  const std::int64_t now_ns = processorTime_ns();
  if (now_ns - computed_ns.exchange(now_ns) < kBusy_ns) return endBy(stop_signal);
  alarm(kPatience_s);
}

/// The first signal requests a stop; a second one, of any kind, ends the program at once. Threads may handle signals at
/// the same time, so the exchange decides which one is first.
void remember(int signal) {
  int none = 0;
  if (!stop_signal.compare_exchange_strong(none, signal)) return endBy(signal);
  computed_ns = processorTime_ns();
  alarm(kPatience_s);
}

// What endClean() has to know.
std::atomic<pid_t> own_process = 0;
std::atomic<bool> json_lines = false, quiet = false;

void write(std::string_view text) {
  if (::write(STDERR_FILENO, text.data(), text.size()) < 0) return;  // nobody is left to tell
}

/// Of two threads that handle signals the first one ends the program.
void endClean(int signal) {
  int none = 0;
  if (getpid() != own_process) return endBy(signal);  // a child that reads a mesh
  if (!stop_signal.compare_exchange_strong(none, signal)) return;
  io::removeUnfinishedFiles();
  std::signal(SIGALRM, SIG_DFL);  // nobody may be reading what follows
  ::alarm(1);
  if (!quiet) {
    write(json_lines ? "{\"level\":\"notice\",\"text\":\"stopped by " : "accessvdb: stopped by ");
    write(stopSignalName());
    write(json_lines ? "; no half-written file is left\"}\n" : "; no half-written file is left\n");
  }
  _exit(128 + signal);
}

void handleWith(void (*handler)(int)) {
  std::signal(SIGINT, handler);
  std::signal(SIGTERM, handler);
  if (std::signal(SIGHUP, handler) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);
}

}  // namespace

void watchStopSignals() {
  std::signal(SIGALRM, lookAgain);
  handleWith(remember);
}

void endOnStopSignals(const Messages& messages) {
  own_process = getpid();
  json_lines = messages.format() == ErrorFormat::Json;
  quiet = messages.quiet();
  handleWith(endClean);
}

int stopSignal() {
  const int signal = stop_signal;
  if (signal != 0) noticed = true;
  return signal;
}

const char* stopSignalName() {
  const int signal = stop_signal;
  return signal == SIGINT ? "SIGINT" : signal == SIGHUP ? "SIGHUP" : "SIGTERM";
}

}  // namespace accessvdb::tools
