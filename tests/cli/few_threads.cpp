// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Preloaded: after ACCESSVDB_TEST_THREADS of them, no thread can be started, as with a limit on processes (root has
/// none, so the limit itself cannot be tested everywhere).
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>

namespace {

std::atomic<int> running{0};

/// Read from the kernel: getenv() knows nothing yet when the program's first check runs.
int most() {
  static const int value = [] {
    char text[1 << 16];
    const int file = open("/proc/self/environ", O_RDONLY);
    const ssize_t size = read(file, text, sizeof text - 1);
    close(file);
    constexpr char kName[] = "ACCESSVDB_TEST_THREADS=";
    const void* found = size < 0 ? nullptr : memmem(text, static_cast<std::size_t>(size), kName, sizeof kName - 1);
    text[size < 0 ? 0 : size] = 0;
    return found == nullptr ? 1 << 30 : std::atoi(static_cast<const char*>(found) + sizeof kName - 1);
  }();
  return value;
}

using Start = int (*)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*);
using Join = int (*)(pthread_t, void**);
}  // namespace

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*body)(void*),
                              void* argument) noexcept {
  if (running.fetch_add(1) >= most()) {
    running.fetch_sub(1);
    return EAGAIN;
  }
  static const auto start = reinterpret_cast<Start>(dlsym(RTLD_NEXT, "pthread_create"));
  return start(thread, attributes, body, argument);
}

extern "C" int pthread_join(pthread_t thread, void** result) {
  static const auto join = reinterpret_cast<Join>(dlsym(RTLD_NEXT, "pthread_join"));
  const int status = join(thread, result);
  if (status == 0) running.fetch_sub(1);
  return status;
}
