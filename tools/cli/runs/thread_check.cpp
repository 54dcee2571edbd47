// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Refuses to run where threads cannot be made. Libraries make some before main() (log4cplus, by way of OpenVDB) and
/// others beside it (TBB), and abort where they cannot. Only the program's own pre-initialisation comes before theirs;
/// there the C library works, that of C++ does not.
#include <pthread.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>

namespace {

/// Of log4cplus.
constexpr int kOfLibraries = 4;
/// As many as are tried at most; each takes about 10 us.
constexpr int kMost = 1024;

pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;

void* passGate(void*) {
  pthread_mutex_lock(&gate);
  pthread_mutex_unlock(&gate);
  return nullptr;
}

/// How many of `wanted` threads can exist at a time.
int startable(int wanted) {
  static pthread_t threads[kMost];
  pthread_attr_t small;
  pthread_attr_init(&small);
  pthread_attr_setstacksize(&small, std::size_t{64} << 10);
  pthread_mutex_lock(&gate);
  int count = 0;
  while (count < wanted && pthread_create(&threads[count], &small, passGate, nullptr) == 0) ++count;
  pthread_mutex_unlock(&gate);
  for (int n = 0; n < count; ++n) pthread_join(threads[n], nullptr);
  pthread_attr_destroy(&small);
  return count;
}

bool wantsJson(int argc, char** argv) {
  for (int n = 1; n < argc; ++n) {
    if (std::strcmp(argv[n], "--error-format=json") == 0) return true;
    if (std::strcmp(argv[n], "--error-format") == 0 && n + 1 < argc && std::strcmp(argv[n + 1], "json") == 0)
      return true;
  }
  return false;
}

void requireThreads(int argc, char** argv, char**) {
  cpu_set_t usable;
  const long processors = sched_getaffinity(0, sizeof usable, &usable) == 0 ? CPU_COUNT(&usable) : 1;
  const int wanted =
      kOfLibraries + (processors < kMost - kOfLibraries ? static_cast<int>(processors) : kMost - kOfLibraries);
  const int count = startable(wanted);
  if (count == wanted) return;
  const char* const form =
      wantsJson(argc, argv)
          ? "{\"level\":\"error\",\"id\":\"limit.threads\",\"exit_code\":5,\"subject\":\"threads\",\"problem\":\"only "
            "%d "
            "of %d can be started\",\"advice\":\"Raise the limit on processes (ulimit -u, or that of the container), "
            "or "
            "end other programs\"}\n"
          : "accessvdb: error[limit.threads] threads: only %d of %d can be started. Raise the limit on processes "
            "(ulimit -u, or that of the container), or end other programs.\n";
  char line[400];
  const int length = std::snprintf(line, sizeof line, form, count, wanted);
  static_cast<void>(!write(STDERR_FILENO, line, static_cast<std::size_t>(length)));
  _exit(5);
}

// Sanitizers start in the same way, and must come first.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
__attribute__((section(".preinit_array"), used)) void (*const kRequireThreads)(int, char**, char**) = requireThreads;
#else
[[maybe_unused]] void (*const kRequireThreads)(int, char**, char**) = requireThreads;
#endif

}  // namespace
