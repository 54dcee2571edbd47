// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/last_line.h"

#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <exception>
#include <new>

#include "accessvdb/program/output_file.h"

namespace accessvdb::tools {
namespace {

constexpr std::int64_t kNever_s = -1'000'000;
pid_t own_process = 0;
bool json_lines = false;
/// An exception that ends the program is not always known (where a library's noexcept stops it), nor is a crash's
/// cause.
std::atomic<std::int64_t> memory_refused_at_s = kNever_s;
std::atomic<pid_t> ender = 0;  ///< the thread that ends the program
volatile sig_atomic_t last_exit_code = 70;

/// Escapes what would end the line or a string of JSON.
class Line {
 public:
  void add(const char* text) {
    for (; *text != 0 && size_ < sizeof text_ - 1; ++text) text_[size_++] = *text;
  }
  void addForeign(const char* text) {
    for (; *text != 0 && size_ < kMostForeign; ++text) {
      const auto byte = static_cast<unsigned char>(*text);
      text_[size_++] = byte < 0x20 || byte == 0x7f || byte == '"' || byte == '\\' ? ' ' : *text;
    }
  }
  void print() {
    text_[size_++] = '\n';
    static_cast<void>(!::write(STDERR_FILENO, text_, size_));  // nobody is left to tell
  }

 private:
  static constexpr std::size_t kMostForeign = 600;
  char text_[1024];
  std::size_t size_ = 0;
};

std::int64_t now_s() {
  timespec now = {};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec;
}

/// A little while ago: what was refused before and borne has nothing to do with how the program ends.
bool memoryWasRefused() {
  constexpr std::int64_t kLittle_s = 5;
  return now_s() - memory_refused_at_s <= kLittle_s;
}

/// Ends the program if its last words take longer: they may wait for a lock that this thread held when it crashed.
void endSoon(int exit_code) {
  constexpr unsigned kMost_s = 2;
  last_exit_code = exit_code;
  ::signal(SIGALRM, [](int) { ::_exit(last_exit_code); });
  sigset_t alarms;
  ::sigemptyset(&alarms);
  ::sigaddset(&alarms, SIGALRM);
  ::pthread_sigmask(SIG_UNBLOCK, &alarms, nullptr);
  ::alarm(kMost_s);
}

[[noreturn]] void endWith(int exit_code, const char* id, const char* subject, const char* problem, const char* advice) {
  if (::getpid() != own_process) ::_exit(exit_code);  // a child; its parent says what happened
  const pid_t thread = ::gettid();
  pid_t nobody = 0;
  if (!ender.compare_exchange_strong(nobody, thread)) {
    if (nobody == thread) ::_exit(exit_code);  // it crashed again over its last words
    for (;;) ::pause();
  }
  endSoon(exit_code);
  char code[16];
  std::snprintf(code, sizeof code, "%d", exit_code);
  Line line;
  line.add(json_lines ? "{\"level\":\"error\",\"id\":\"" : "accessvdb: error[");
  line.add(id);
  line.add(json_lines ? "\",\"exit_code\":" : "] ");
  if (json_lines) line.add(code);
  if (json_lines) line.add(",\"subject\":\"");
  line.add(subject);
  line.add(json_lines ? "\",\"problem\":\"" : *subject != 0 ? ": " : "");
  line.addForeign(problem);
  line.add(json_lines ? "\",\"advice\":\"" : ". ");
  line.add(advice);
  line.add(json_lines ? "\"}" : ".");
  line.print();  // first: what follows needs memory and locks, which may be what is broken
  io::removeUnfinishedFiles();
  ::_exit(exit_code);
}

constexpr const char* kIsABug = "This is a bug: please report it with this line and the command";

[[noreturn]] void endUnhandled() {
  try {
    if (std::current_exception()) throw;
  } catch (const std::bad_alloc&) {
    endOutOfMemory();
  } catch (const std::exception& error) {
    endWith(70, "internal.exception", "", error.what(), kIsABug);
  } catch (...) {
    endWith(70, "internal.exception", "", "an unknown exception", kIsABug);
  }
  if (memoryWasRefused()) endOutOfMemory();
  endWith(70, "internal.exception", "", "a library gave up", kIsABug);
}

[[noreturn]] void refuseMemory() {
  memory_refused_at_s = now_s();
  throw std::bad_alloc();
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // these say more about a crash
/// Some libraries (blosc, OpenSSL) use memory without looking whether they got any. A system that has none for them has
/// none for this either; a container's limit is met in another way, by SIGKILL.
bool memoryIsShort() {
  constexpr std::size_t kBytes = std::size_t{64} << 20;
  void* const place = ::mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (place == MAP_FAILED) return true;
  ::munmap(place, kBytes);
  return memoryWasRefused();
}

void endCrashed(int signal) {
  if (::getpid() == own_process && memoryIsShort()) endOutOfMemory();
  const char* const name = signal == SIGABRT  ? "a library aborted (SIGABRT)"
                           : signal == SIGBUS ? "it crashed (SIGBUS)"
                           : signal == SIGFPE ? "it crashed (SIGFPE)"
                           : signal == SIGILL ? "it met an instruction that this processor lacks (SIGILL)"
                                              : "it crashed (SIGSEGV)";
  endWith(
      70, "internal.crash", "the program", name,
      "Where memory is limited (ulimit -v, a container), raise the limit; else this is a bug: please report it with "
      "this line and the command");
}

void catchCrashes() {
  static char stack[1 << 16];  // of its own: the program's may be full
  stack_t other = {};
  other.ss_sp = stack;
  other.ss_size = sizeof stack;
  ::sigaltstack(&other, nullptr);
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) {
    struct sigaction action = {};
    action.sa_handler = endCrashed;
    action.sa_flags = SA_ONSTACK;  // stays for other threads, which may crash of the same at the same time
    ::sigaction(signal, &action, nullptr);
  }
}
#else
void catchCrashes() {}
#endif

}  // namespace

void endWithOneLine(int argc, char** argv) noexcept {
  own_process = ::getpid();
  for (int n = 1; n < argc; ++n) {
    const bool next =
        std::strcmp(argv[n], "--error-format") == 0 && n + 1 < argc && std::strcmp(argv[n + 1], "json") == 0;
    if (next || std::strcmp(argv[n], "--error-format=json") == 0) json_lines = true;
  }
  std::set_terminate(endUnhandled);
  std::set_new_handler(refuseMemory);
  catchCrashes();
}

void endOutOfMemory() noexcept {
  endWith(OutOfMemory::kExitCode, OutOfMemory::kId, OutOfMemory::kSubject, OutOfMemory::kProblem, OutOfMemory::kAdvice);
}

}  // namespace accessvdb::tools
