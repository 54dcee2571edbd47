// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/guarded_child.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <exception>
#include <fstream>

namespace accessvdb::internal {
namespace {

constexpr std::size_t kMaxAnswerBytes = std::size_t{16} << 20;
constexpr char kAnswer = 'A', kFailure = 'F';

void limitResource(decltype(RLIMIT_CPU) resource, std::uint64_t value) {
  rlimit limit;
  if (getrlimit(resource, &limit) != 0) return;
  if (limit.rlim_max == RLIM_INFINITY || value < limit.rlim_max) limit.rlim_max = static_cast<rlim_t>(value);
  limit.rlim_cur = limit.rlim_max;
  setrlimit(resource, &limit);
}

std::uint64_t mappedBytes() {
  std::uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

void sendAll(int fd, const std::string& text) {
  for (std::size_t sent = 0; sent < text.size();) {
    const ssize_t n = ::write(fd, text.data() + sent, text.size() - sent);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return;
    sent += static_cast<std::size_t>(n);
  }
}

struct ChildJob {
  int fd;
  const std::function<std::string()>* run;
};

/// Set in the child only.
const ChildJob* job_of_child = nullptr;

/// The thread has no handler of exceptions, so that a throw calls this where it happens: nothing is unwound.
[[noreturn]] void sendFailure() {
  std::string answer(1, kFailure);
  try {
    std::rethrow_exception(std::current_exception());
  } catch (const std::exception& error) {
    answer += error.what();
  } catch (...) {
    answer += "unknown error";
  }
  sendAll(job_of_child->fd, answer);
  ::_exit(0);
}

extern "C" void* runJob(void*) {
  sendAll(job_of_child->fd, kAnswer + (*job_of_child->run)());
  ::_exit(0);
}

[[noreturn]] void runChild(int fd, const ChildLimits& limits, const std::function<std::string()>& job) {
  const int null = ::open("/dev/null", O_RDWR | O_CLOEXEC);
  if (null >= 0) {
    ::dup2(null, 0);
    ::dup2(null, 1);
    ::dup2(null, 2);
  }
  for (const int fatal : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGINT, SIGTERM}) ::signal(fatal, SIG_DFL);
  limitResource(RLIMIT_CORE, 0);
  limitResource(RLIMIT_CPU, static_cast<std::uint64_t>(limits.time.count()));
#if !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)  // their shadow memory takes terabytes of address space
  limitResource(RLIMIT_AS, mappedBytes() + limits.extra_memory_bytes);
#endif
  const ChildJob here = {fd, &job};
  job_of_child = &here;
  std::set_terminate(sendFailure);
  pthread_t thread;
  if (pthread_create(&thread, nullptr, runJob, nullptr) == 0) pthread_join(thread, nullptr);
  ::_exit(1);
}

/// Reads until the child closes its end; false on time-out or if the answer is too long.
bool receive(int fd, std::chrono::seconds time, std::string& text) {
  const auto deadline = std::chrono::steady_clock::now() + time;
  std::array<char, 65536> block;
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
    if (left.count() <= 0) return false;
    pollfd ready = {fd, POLLIN, 0};
    const int polled = ::poll(&ready, 1, static_cast<int>(left.count()));
    if (polled < 0 && errno == EINTR) continue;
    if (polled <= 0) return false;
    const ssize_t n = ::read(fd, block.data(), block.size());
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return n == 0;
    text.append(block.data(), static_cast<std::size_t>(n));
    if (text.size() > kMaxAnswerBytes) return false;
  }
}

}  // namespace

ChildResult runInChild(const ChildLimits& limits, const std::function<std::string()>& job) {
  std::array<int, 2> ends;
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return {false, "cannot create a pipe to a child process"};
  const pid_t child = ::fork();
  if (child < 0) {
    ::close(ends[0]);
    ::close(ends[1]);
    return {false, "cannot start a child process"};
  }
  if (child == 0) {
    ::close(ends[0]);
    runChild(ends[1], limits, job);
  }
  ::close(ends[1]);
  std::string text;
  const bool complete = receive(ends[0], limits.time, text);
  ::close(ends[0]);
  if (!complete) ::kill(child, SIGKILL);
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!complete) return {false, "reading it took too long"};
  if (text.empty() || !WIFEXITED(status)) return {false, "the library that reads it crashed on it"};
  return {text.front() == kAnswer, text.substr(1)};
}

}  // namespace accessvdb::internal
